"""What to say about a name that is not in the expression language, and what may have been meant."""

from __future__ import annotations

from difflib import get_close_matches

from dobc_design.coupling.notation import names_in_words, variable_names
from dobc_design.coupling.tokens import LONGEST_QUOTE, Fault, Repair, Token, quote
from dobc_design.coupling.tree import FUNCTIONS

_OTHER_NAMES = {
    "ln": "log",
    "arctan": "atan",
    "arctg": "atan",
    "tg": "tan",
    "th": "tanh",
    "sh": "sinh",
    "ch": "cosh",
    "fabs": "abs",
    "maximum": "max",
    "minimum": "min",
    "sat": "clip",
    "saturate": "clip",
}
_NO_INVERSE = "the only inverse function is atan"
_FOREIGN = {
    "e": "the number e is written exp(1), and e**y is exp(y)",
    "log10": "write log(y)/log(10) for log10(y)",
    "log2": "write log(y)/log(2) for log2(y)",
    "expm1": "write exp(y) - 1 for expm1(y)",
    "log1p": "write log(1 + y) for log1p(y)",
    "asin": _NO_INVERSE,
    "arcsin": _NO_INVERSE,
    "acos": _NO_INVERSE,
    "arccos": _NO_INVERSE,
    "asinh": _NO_INVERSE,
    "acosh": _NO_INVERSE,
    "atanh": _NO_INVERSE,
    "atan2": _NO_INVERSE,
    "arcsinh": _NO_INVERSE,
    "arccosh": _NO_INVERSE,
    "arctanh": _NO_INVERSE,
    "sign": "a coupling must be continuous; a steep one is tanh(100*y)",
    "sgn": "a coupling must be continuous; a steep one is tanh(100*y)",
}


def unknown_name(token: Token, *, dimension: int, called: bool) -> Fault:
    """Return the fault of a name that means nothing; ``called`` tells that ( follows it."""
    names = variable_names(dimension)
    word = token.text.lower()
    hint = _FOREIGN.get(word)
    if hint is not None:
        return Fault(token.start, quote(token), hint)
    if word[0] == "y" and (word[1:].strip("_").isdigit() or word == "y"):
        guess = "y" + (word[1:].strip("_") or "1") if word != "y" or dimension > 1 else "y"
        repair = Repair(token.start, token.end, guess) if guess in names else None
        why = f"the variables are {names_in_words(dimension)}" if dimension > 1 else "the only variable is y"
        return Fault(token.start, quote(token), why, repair=repair)
    return Fault(
        token.start,
        quote(token),
        f"the names are {names_in_words(dimension)}, pi, and the functions {' '.join(FUNCTIONS)}",
        repair=_guess_name(token, names=names, called=called),
    )


def _guess_name(token: Token, *, names: tuple[str, ...], called: bool) -> Repair | None:
    word = token.text.lower()
    allowed = ["pi", *FUNCTIONS]
    if word in ("x", "z") and not called:
        guess = names[0]
    elif word in allowed:
        guess = word
    elif word in _OTHER_NAMES:
        guess = _OTHER_NAMES[word]
    elif len(word) > 2 and (close := get_close_matches(word[:LONGEST_QUOTE], allowed, cutoff=0.7)):
        guess = max(close, key=lambda name: sorted(name) == sorted(word))
    else:
        return None
    return Repair(token.start, token.end, guess)
