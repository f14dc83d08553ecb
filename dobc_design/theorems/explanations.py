"""What each condition means, in words: for `dobc explain`, reports and documentation."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """One condition: its statement as LaTeX and as plain text, what PROVED and REFUTED mean, where it comes from."""

    title: str
    statement: str
    plain: str
    meaning: str
    proved: str
    refuted: str
    source: str


EXPLANATIONS: dict[str, Explanation] = {
    "observability": Explanation(
        title="Observability of the exosystem",
        statement=r"\operatorname{rank}\,[C;\ CA;\ \dots;\ CA^{q-1}] = q",
        plain="rank [C; CA; ...; CA^(q-1)] = q",
        meaning="Every state of the disturbance's generator leaves a trace in d = C xi.",
        proved="The estimation error can be made to decay as fast as wanted by the choice of W.",
        refuted="A part of the exosystem never reaches the agents. Harmless if it decays; see detectability.",
        source="Paper, (12) and (17).",
    ),
    "detectability": Explanation(
        title="Detectability of the exosystem",
        statement=r"A \text{ is Hurwitz on } \bigcap_k \ker CA^k",
        plain="A is Hurwitz on the states that C never sees",
        meaning="What C does not see dies out by itself. Exactly then some W makes A - WC Hurwitz.",
        proved="A gain W exists.",
        refuted="No W exists for this model. The disturbance itself does not contain the hidden part: leave it out.",
        source="Theory, Decision theorem: one of the two causes of infeasibility.",
    ),
    "hurwitz": Explanation(
        title="A - WC is Hurwitz",
        statement=r"\max \operatorname{Re}\,\sigma(A - WC) < 0",
        plain="max Re of the eigenvalues of A - WC < 0",
        meaning="The estimation error eps' = (A - WC) eps decays (Routh's test over the rationals).",
        proved="The estimate of the disturbance converges, at least like exp(-rate t).",
        refuted="With this W the estimation error does not decay.",
        source="Paper, (13) and (17).",
    ),
    "reachability": Explanation(
        title="Every agent hears a pinned agent",
        statement=r"\text{each agent is reached from } \{i : k_i \ne 0\}",
        plain="each agent is reached from an agent with k != 0",
        meaning="Information flows from the pinned agents to everybody, perhaps through others.",
        proved="The graph does not stand in the way.",
        refuted="The agents named listen to nobody who hears a pin; moved away together, they stay away in this mode.",
        source="Theory, section 2.",
    ),
    "lemma1": Explanation(
        title="Lemma 1: pinning without disturbance",
        statement=r"\Lambda(J) = J + J^T - (K + K^T) < 0",
        plain="Lambda(J) = J + J' - (K + K') < 0",
        meaning="V = e'e decreases. The paper's F of (10) is half of Lambda.",
        proved="Without disturbance the agents reach the target from close by (linear couplings: from everywhere);"
        " V' <= -2 rate V.",
        refuted="V = e'e grows in some direction. This alone does not mean that consensus fails.",
        source="Paper, Lemma 1, (10), with J at the target.",
    ),
    "theorem1": Explanation(
        title="Theorem 1: pinning and disturbance observer, fixed topology",
        statement=r"\Psi = \begin{pmatrix} \Lambda & I \otimes C \\ (I \otimes C)^T & I \otimes \Omega_0 \end{pmatrix}"
        r" < 0,\quad \Omega_0 = PA + A^TP - C^TQ^T - QC,\quad P > 0",
        plain="Psi = [[Lambda, I (x) C], [(I (x) C)', I (x) Omega0]] < 0 and P > 0, with Omega0 = PA + A'P - C'Q' - QC",
        meaning="V = e'e + sum eps_i' P eps_i decreases, with W = P^-1 Q.",
        proved="Consensus despite the disturbance, from close by (linear couplings: from everywhere).",
        refuted="No P and Q satisfy it: either Lambda is not negative definite, or no gain (or not this W) makes the"
        " estimation error decay.",
        source="Paper, Theorem 1, (18); decided by the Decision theorem.",
    ),
    "theorem2": Explanation(
        title="Theorem 2: switching topology",
        statement=r"\Psi_\sigma < 0 \text{ for every mode } \sigma, \text{ with one } P \text{ and one } Q",
        plain="Psi < 0 in every mode, with one P and one Q",
        meaning="One V decreases in every mode, so the modes may switch in any way.",
        proved="Consensus under arbitrary switching, from close by (linear couplings: from everywhere).",
        refuted="No common P and Q exist. Consensus may still hold for slow or special switching.",
        source="Paper, Theorem 2, (28).",
    ),
    "theorem1-printed": Explanation(
        title="Theorem 1 with the P given",
        statement=r"\Psi < 0 \text{ with } P \text{ as given and } Q = PW",
        plain="Psi < 0 with P as given and Q = PW",
        meaning="Tests the pair that was printed or typed, as it is.",
        proved="That very pair works.",
        refuted="That pair fails. A scaled P may work: Psi < 0 iff lambda_max(Lambda) < -lambda_max(S), and S shrinks"
        " when P grows.",
        source="Paper, Example 1.",
    ),
    "theorem2-printed": Explanation(
        title="Theorem 2 with the P given",
        statement=r"\Psi_\sigma < 0 \text{ for every mode } \sigma \text{ with } P \text{ as given and } Q = PW",
        plain="Psi < 0 in every mode with P as given and Q = PW",
        meaning="Tests the pair that was printed or typed, as it is, in every mode.",
        proved="That very pair works for arbitrary switching.",
        refuted="That pair fails in some mode. A scaled P may work.",
        source="Paper, Example 2.",
    ),
}
