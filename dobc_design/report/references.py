"""What the theorems and the exact decisions rest on, as BibTeX; nothing is stated that its source does not say."""

from __future__ import annotations

from typing import Final

_ENTRIES: Final = """\
@misc{consensus-dobc,
  key   = {Consensus},
  title = {Consensus of mobile multiple agent systems with disturbance-observer-based control},
  note  = {Theorems 1 and 2, Lemma 1; the copy used states no authors, journal, year or pages}
}

@article{rump2006,
  author  = {Rump, Siegfried M.},
  title   = {Verification of Positive Definiteness},
  journal = {BIT Numerical Mathematics},
  volume  = {46},
  pages   = {433--452},
  year    = {2006}
}

@article{dirr2015,
  author  = {Dirr, Gunther and Ito, Hiroshi and Rantzer, Anders and R{\\"u}ffer, Bj{\\"o}rn S.},
  title   = {Separable {Lyapunov} functions for monotone systems: Constructions and limitations},
  journal = {Discrete and Continuous Dynamical Systems, Series B},
  volume  = {20},
  number  = {8},
  pages   = {2497--2526},
  year    = {2015}
}
"""


def bibliography(version: str) -> str:
    """The entries, with one for this program in the version that made the certificate."""
    own = "".join(each for each in version if each.isalnum() or each in ".+-")
    return _ENTRIES + (
        "\n@misc{dobc-design,\n  author = {{dobc\\_design contributors}},\n"
        "  title  = {dobc\\_design: design and exact certification of disturbance-observer-based consensus control},\n"
        f"  note   = {{Version {own}}}\n}}\n"
    )
