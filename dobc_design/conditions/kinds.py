"""The register of checks: one row per id of a check, in the order in which they are tried; words and flags only.

What reads a claim and what confirms it are found by the topic, in ``certificate.claims`` and ``certification.recheck``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

from dobc_design._show.cards import Card, Shown

#: What a proof is worth.  "part": a fact of the network or of the exosystem alone, the same for every coupling.
#: "paper": Lemma 1 and the theorems.  "given": a theorem with the P of the problem file.  "region": for a set of
#: starts.  "timing": carries a region over to late or held messages.  "rest": refutes a region.  "settling": a time.
#: "plant": what the model leaves out, bounded.  "safety": a set that is not left, and with a rate for a set of starts.
Role = Literal["part", "paper", "given", "region", "timing", "rest", "settling", "plant", "safety"]

#: By topic: the modules that decide a check, and the file of the second program.
_DECIDED_IN: Final = {
    "observer": ("conditions/observer/decide.py", "exact/observability.py", "exact/polynomial.py"),
    "consensus": ("conditions/consensus/decide.py", "conditions/consensus/network.py", "exact/definite.py"),
    "linearisation": ("conditions/linearisation/decide.py", "exact/polynomial.py"),
    "weighted": ("conditions/weighted/decide.py", "conditions/weighted/network.py"),
    "separable": ("conditions/separable/decide.py", "conditions/separable/timing.py"),
    "margins": ("conditions/margins/decide.py", "conditions/separable/decide.py"),
    "quadratic": ("conditions/quadratic/decide.py",),
    "boxes": ("conditions/boxes/decide.py",),
    "equilibrium": ("conditions/equilibrium/decide.py",),
    "schedule": ("conditions/schedule/decide.py", "conditions/schedule/cycles.py", "conditions/schedule/rows.py"),
    "accuracy": ("conditions/accuracy/decide.py", "exact/peaks.py"),
    "graphs": ("conditions/graphs/decide.py", "conditions/schedule/cycles.py"),
}
#: The file of the second program for an id or a topic, where it is not one of the same name.
_CHECKERS: Final = {
    "observer": "consensus",
    "weighted": "consensus",
    "linearisation": "consensus",
    "boxes": "quadratic",
    "equilibrium": "separable",
    "schedule": "cycles",
    "settling": "schedule",
}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Kind(Shown):
    """One kind of check.  ``topic``: its folder in ``conditions/``.  ``name`` and ``decides`` are the words of reports,
    the fields from ``title`` to ``source`` those of `dobc explain`; ``statement`` is LaTeX."""

    id: str
    topic: str
    role: Role
    name: str
    decides: str
    title: str
    statement: str
    plain: str
    proved: str
    refuted: str
    source: str = "Beyond the paper; theory, Regions by a weighted maximum."

    def _card(self) -> Card:
        facts = [("proved", self.proved), ("refuted", self.refuted), ("source", self.source)]
        return Card(title=self.title, text=f"{self.plain}. {self.meaning}", facts=facts)

    @property
    def meaning(self) -> str:
        """What it decides, in one sentence."""
        return f"It decides {self.decides}."

    @property
    def decided_in(self) -> tuple[str, ...]:
        """The modules that decide it."""
        return _DECIDED_IN[self.topic]

    @property
    def checker(self) -> str:
        """The file of the second program that decides it again."""
        return f"checker/{_CHECKERS.get(self.id, _CHECKERS.get(self.topic, self.topic))}.py"

    @property
    def is_consensus(self) -> bool:
        """Whether its proof is a proof of consensus."""
        return self.role in ("paper", "given", "region")

    @property
    def short(self) -> str:
        """The name where there is little room: "Lemma 1", "Lur’e"."""
        return self.name.partition(":")[0].removesuffix(" certificate").removesuffix(" proof")


_BALL = "Every start with |e| <= R (Euclidean, all of e) and |eps_i| <= s reaches the target under arbitrary switching."
_REGION = "Beyond the paper: its Theorems 1 and 2 in a region; theory, Regions by quadratic functions."
_observer = partial(Kind, topic="observer", role="part")
_paper, _given = partial(Kind, topic="consensus", role="paper"), partial(Kind, topic="consensus", role="given")
_weighted = partial(Kind, topic="weighted", role="paper", source="Beyond the paper; theory, section 10.")
_timing = partial(Kind, topic="separable", role="timing")
_margin = partial(Kind, topic="margins", role="plant", source="Beyond the paper; theory, section 12.")

_ROWS: Final = (
    _observer(
        id="observability",
        name="Observability of (A,\xa0C)",
        decides="whether every state of the disturbance generator appears in d = C ξ; then W can give the estimate any"
        " decay rate",
        title="Observability of the exosystem",
        statement=r"\operatorname{rank}\,[C;\ CA;\ \dots;\ CA^{q-1}] = q",
        plain="rank [C; CA; ...; CA^(q-1)] = q",
        proved="With a suitable W the estimation error decays at any wanted rate.",
        refuted="A part of the exosystem never reaches the agents. Harmless if it decays; see detectability.",
        source="Paper, (12) and (17).",
    ),
    _observer(
        id="detectability",
        name="Detectability of (A,\xa0C)",
        decides="whether the states that C does not see decay by themselves; exactly then a suitable W exists",
        title="Detectability of the exosystem",
        statement=r"A \text{ is Hurwitz on } \bigcap_k \ker CA^k",
        plain="A is Hurwitz on the states that C never sees",
        proved="A gain W exists.",
        refuted="No W exists for this model. The disturbance itself does not contain the hidden part: leave it out.",
        source="Theory, Decision theorem: one of the two causes of infeasibility.",
    ),
    _observer(
        id="hurwitz",
        name="A − WC is Hurwitz",
        decides="whether the estimation error (17) decays with this W, by Routh’s table",
        title="A - WC is Hurwitz",
        statement=r"\max \operatorname{Re}\,\sigma(A - WC) < 0",
        plain="max Re of the eigenvalues of A - WC < 0",
        proved="The estimate of the disturbance converges, at least like exp(-rate t).",
        refuted="With this W the estimation error does not decay.",
        source="Paper, (13) and (17).",
    ),
    Kind(
        id="reachability",
        topic="consensus",
        role="part",
        name="Every agent hears a pin",
        decides="whether every agent hears a pinned agent, directly or through others; nothing pulls the others to the"
        " target",
        title="Every agent hears a pinned agent",
        statement=r"\text{each agent is reached from } \{i : k_i \ne 0\}",
        plain="each agent is reached from an agent with k != 0",
        proved="A path of arcs leads from a pinned agent to every agent.",
        refuted="No pinned agent reaches the agents named: in this mode nothing pulls them to the target.",
        source="Theory, When is there a pair P, Q?",
    ),
    _paper(
        id="lemma1",
        name="Lemma 1: Λ(J) < 0",
        decides="whether V = Σ eᵢ′eᵢ decreases when there is no disturbance (10)",
        title="Lemma 1: pinning without disturbance",
        statement=r"\Lambda(J) = J + J^T - (K + K^T) < 0",
        plain="Lambda(J) = J + J' - (K + K') < 0, twice the F of (10)",
        proved="Without disturbance the agents reach the target from close by (linear couplings: from everywhere); V'"
        " <= -2 rate V.",
        refuted="V = e'e grows in some direction. This alone does not mean that consensus fails.",
        source="Paper, Lemma 1, (10), with J at the target.",
    ),
    _paper(
        id="theorem1",
        name="Theorem 1: Ψ < 0",
        decides="whether some P and Q satisfy (18), so that V = Σ eᵢ′eᵢ + Σ εᵢ′Pεᵢ decreases with the observer in the"
        " loop",
        title="Theorem 1: pinning and disturbance observer, fixed topology",
        statement=r"\Psi = \begin{pmatrix} \Lambda & I \otimes C \\ (I \otimes C)^T & I \otimes \Omega_0 \end{pmatrix}"
        r" < 0,\quad \Omega_0 = PA + A^TP - C^TQ^T - QC,\quad P > 0",
        plain="Psi = [[Lambda, I (x) C], [(I (x) C)', I (x) Omega0]] < 0 and P > 0, with Omega0 = PA + A'P - C'Q' - QC"
        " and Q = PW",
        proved="Consensus despite the disturbance, from close by (linear couplings: from everywhere).",
        refuted="No P and Q satisfy it: either Lambda is not negative definite, or no gain (or not this W) makes the"
        " estimation error decay.",
        source="Paper, Theorem 1, (18); decided by the Decision theorem.",
    ),
    _paper(
        id="theorem2",
        name="Theorem 2: Ψ < 0 in every mode",
        decides="whether one P and one Q satisfy (18) in all modes, so that they may switch in any way",
        title="Theorem 2: switching topology",
        statement=r"\Psi_\sigma < 0 \text{ for every mode } \sigma, \text{ with one } P \text{ and one } Q",
        plain="Psi < 0 in every mode, with one P and one Q",
        proved="Consensus under arbitrary switching, from close by (linear couplings: from everywhere).",
        refuted="No common P and Q exist. Consensus may still hold for slow or special switching.",
        source="Paper, Theorem 2, (28).",
    ),
    _given(
        id="theorem1-printed",
        name="Theorem 1 with the P given",
        decides="whether the P and W of the problem file satisfy (18) as they stand",
        title="Theorem 1 with the P given",
        statement=r"\Psi < 0 \text{ with } P \text{ as given and } Q = PW",
        plain="Psi < 0 with P as given and Q = PW",
        proved="This P with this W satisfies (18).",
        refuted="This pair fails. A scaled P may work: Psi < 0 iff lambda_max(Lambda) < -lambda_max(S), and S shrinks"
        " when P grows.",
        source="Paper, Example 1.",
    ),
    _given(
        id="theorem2-printed",
        name="Theorem 2 with the P given",
        decides="whether the P and W of the problem file satisfy (18) in every mode as they stand",
        title="Theorem 2 with the P given",
        statement=r"\Psi_\sigma < 0 \text{ for every mode } \sigma \text{ with } P \text{ as given and } Q = PW",
        plain="Psi < 0 in every mode with P as given and Q = PW",
        proved="This P with this W satisfies (18) in every mode; switching may be arbitrary.",
        refuted="This pair fails in some mode. A scaled P may work.",
        source="Paper, Example 2.",
    ),
    _weighted(
        id="theorem1-weighted",
        name="Theorem 1 with weights",
        decides="whether V = Σ dᵢeᵢ′eᵢ + Σ εᵢ′Pεᵢ decreases for some weights dᵢ > 0; they exist iff every agent is"
        " reached, up to the true rate",
        title="Theorem 1 with a weight for each agent",
        statement=r"D M + M^T D - 2\beta D - D (I \otimes S) D > 0,\quad M = (K \otimes I) - J,\ D > 0"
        r" \text{ diagonal}",
        plain="D M + M' D - 2 beta D - D (I (x) S) D > 0 with M = K - J and D > 0 diagonal; S = C (-Omega0 - 2 beta"
        " P)^-1 C'",
        proved="Consensus despite the disturbance, from close by (linear couplings: from everywhere); V' <= -2 rate V.",
        refuted="Never: where no weights exist, reachability or the observer is refuted.",
    ),
    _weighted(
        id="theorem2-weighted",
        name="Theorem 2 with weights",
        decides="whether V = Σ dᵢeᵢ′eᵢ + Σ εᵢ′Pεᵢ decreases in every mode for the same weights dᵢ > 0",
        title="Theorem 2 with a weight for each agent",
        statement=r"D M_\sigma + M_\sigma^T D - 2\beta D - D (I \otimes S) D > 0 \text{ for every mode } \sigma",
        plain="D M + M' D - 2 beta D - D (I (x) S) D > 0 in every mode, with one D and one P",
        proved="Consensus under arbitrary switching, from close by (linear couplings: from everywhere).",
        refuted="Never: modes without common weights may have another common V.",
    ),
    Kind(
        id="linearisation",
        topic="linearisation",
        role="paper",
        name="Linearisation",
        decides="whether every eigenvalue of the loop, linearised at the target, has a negative real part; for small"
        " networks with couplings of any sign",
        title="The linearisation at the target",
        statement=r"\operatorname{Re}\,\sigma(J - K) < 0,\quad \operatorname{Re}\,\sigma(A - WC) < 0",
        plain="max Re of the eigenvalues of J - K and of A - WC < 0",
        proved="Consensus despite the disturbance, from close by (linear couplings: from everywhere).",
        refuted="The target is unstable: consensus fails in every neighbourhood of it.",
        source="Lyapunov's first method, decided by Routh's table; theory, section 10.",
    ),
    Kind(
        id="max-separable",
        topic="separable",
        role="region",
        name="Max-separable certificate",
        decides="whether boxes around the target shrink: the largest weighted error decreases",
        title="Max-separable certificate: every start in a box",
        statement=r"\max_{|e_j| \le s v_j,\ e_i = s v_i} e_i' \le -\alpha s v_i\quad \text{for all } s \in (0,"
        r" \rho],\ i,\ \sigma",
        plain="on the face e_i = s v_i of the box |e_j| <= s v_j: e_i' <= -alpha s v_i, for all s in (0, rho], every"
        " agent and mode, and the same on the opposite face",
        proved="Every start with |e| <= R and |eps_i| <= s reaches the target under arbitrary switching, R and s as"
        " the domain says; V = max |e_i|/v_i + kappa max sqrt(eps_i' P eps_i) decays at the rate, and no such start"
        " leaves {V <= rho}.",
        refuted="No v exists: each agent named has a mode in which it is not pinned and hears nobody outside"
        " their group. Consensus may still hold for signals that leave those modes.",
        source="Beyond the paper (it has a condition at one point); theory, Regions by a weighted maximum.",
    ),
    _timing(
        id="delay",
        name="Delays",
        decides="whether the proof still holds with delayed messages; delays may vary and differ from arc to arc",
        title="Delays that the max-separable certificate allows",
        statement=r"\text{the rows with } v_j \to \theta v_j,\ \theta \ge e^{\lambda T},\ \alpha = \lambda",
        plain="the rows of max-separable hold with theta v_j for v_j of each neighbour j, theta >= exp(lambda T), rate"
        " lambda",
        proved="For all such delays max |e_i|/v_i decays at the rate lambda, with an observer at every smaller"
        " rate. Any bounded delay leaves some positive rate.",
        refuted="Never: a longer delay may be harmless, too.",
    ),
    _timing(
        id="sampling",
        name="Sampling",
        decides="whether the proof holds with couplings and pinning held between samples; d̂ acts continuously",
        title="Sampling period that the max-separable certificate allows",
        statement=r"T\,\bigl(\textstyle\sum_j w_{ij} L_{ij} + k_i\bigr) \le 1 \quad \text{for every agent}",
        plain="T (sum_j w L_ij + k_i) <= 1 for every agent, L_ij a bound of the mean slope of h in the box",
        proved="From one sample to the next max |e_i|/v_i falls at least by the factor f < 1, 1 - T alpha <= f, up to"
        " what the observer error adds.",
        refuted="Never: longer periods may work too.",
    ),
    _margin(
        id="tolerance",
        name="Tolerance",
        decides="whether the proof holds for all weights and gains within relative errors, each on its own",
        title="Errors of weights and gains that the certificate allows",
        statement=r"\text{the rows for all } |\Delta w_{ij}| \le \delta_w w_{ij},\ |\Delta k_i| \le \delta_k k_i",
        plain="the rows of max-separable (without a region: at the target) hold for every w in [w (1 - dw), w (1 + dw)]"
        " and k in [k (1 - dk), k (1 + dk)]; observers that do not know the weights: kappa eta < alpha as well",
        proved="Consensus for all such weights and gains, constant or varying, while the estimation error decays.",
        refuted="Never: larger errors may be harmless, too.",
    ),
    _margin(
        id="actuators",
        name="Inputs",
        decides="how large the inputs can become from the certified starts, and whether actuators with limits saturate",
        title="Largest inputs on the certified set",
        statement=r"|u_i| \le \rho \max(|k_i|_1 v_i, 1/\kappa) + \max_t |d_i|",
        plain="|u_i| <= rho max(|k_i|_1 v_i, 1/kappa) + max |d_i| on {V <= rho}",
        proved="From every start of the domain no component of u_i exceeds its bound, nor a limit that is given, for"
        " the model with the errors of gains in [uncertainty] but without its disturbance, drift and noise.",
        refuted="Never: the bound may be larger than what happens.",
    ),
    Kind(
        id="lure",
        topic="quadratic",
        role="region",
        name="Lur’e certificate",
        decides="whether a quadratic V decreases for all slopes the coupling has in a region (circle criterion)",
        title="Quadratic certificate for a region: Theorems 1 and 2 with bounded gains",
        statement=r"P_e A_0 + A_0^T P_e + 2\beta P_e + P_e\bigl(I \otimes S + \tfrac12 B T^{-1} B^T\bigr) P_e + 2\,"
        r" C_E^T T D^2 C_E < 0",
        plain="P_e A0 + A0' P_e + 2 beta P_e + P_e (I (x) S + B T^-1 B'/2) P_e + 2 C_E' T D^2 C_E < 0",
        proved=_BALL,
        refuted="Not used: that one certificate fails says nothing about the others.",
        source=_REGION,
    ),
    Kind(
        id="exhaustive",
        topic="boxes",
        role="region",
        name="Exhaustive proof",
        decides="whether a quadratic V decreases in every box of a grid between a Lur’e ball and a larger set; for"
        " small networks",
        title="Boxes around a quadratic certificate, for small networks",
        statement=r"\dot V < 0 \text{ on } \{c_0 \le e^T P_e e \le c_1\}, \text{ box by box}",
        plain="V' < 0 wherever c0 <= e' P_e e <= c1, box by box",
        proved=_BALL,
        refuted="Not used: that one V fails says nothing about the others.",
        source=_REGION,
    ),
    Kind(
        id="equilibrium",
        topic="equilibrium",
        role="rest",
        name="Another equilibrium",
        decides="whether the region asked for holds a start at which the agents rest away from the target",
        title="A second equilibrium inside the region",
        statement=r"h(e) - (K \otimes I)\, e = 0,\quad e \ne 0",
        plain="h(e) - (K (x) I) e = 0 for some e other than 0",
        proved="Never: that none is found does not mean that there is none.",
        refuted="Consensus fails in the region asked for: agents that start there, with exact estimates, stay there.",
        source="Format of certificates, The overall verdict, 2 (d).",
    ),
    Kind(
        id="schedule",
        topic="schedule",
        role="region",
        name="Weights that move with time",
        decides="whether every signal that keeps the guarantee of [switching] leads to the target, though no mode alone"
        " may",
        title="Weights that move with the modes",
        statement=r"\textstyle\sum_j \sup h_{ij} - k_i s v_i \le s v_i'(t),\quad v^p(t) \le e^{-rt} v^q(0)",
        plain="on the faces e_i = +-s v_i(t) the network pushes inwards faster than they move; v(t) <= exp(-r t) v'(0)"
        " when a phase ends",
        proved="Every signal that keeps the guarantee leads to the target, at the rate shown; without a rate by the"
        " graphs alone: couplings rise, and every cycle of modes reaches every agent.",
        refuted="Never: that no weights are found does not mean that there are none.",
        source="Theory, Schedules.",
    ),
    Kind(
        id="markov",
        topic="graphs",
        role="region",
        name="Markov signal",
        decides="whether the Markov chain of [switching] leads to the target almost surely, in the mean or in mean"
        " square, though not every signal may",
        title="A Markov chain that draws the modes",
        statement=r"A_p^T w_p + \textstyle\sum_q g_{pq} w_q \le -r w_p \quad\text{or}\quad A_p^T P_p + P_p A_p +"
        r" \textstyle\sum_q g_{pq} P_q + 2 r P_p < 0",
        plain="in the mean: A_p' w_p + sum_q g_pq w_q <= -r w_p; in mean square: A_p' P_p + P_p A_p + sum_q g_pq P_q"
        " + 2 r P_p < 0; almost surely: couplings rise, and modes that the chain never leaves reach every agent",
        proved="From every start of the domain and every first mode all errors decay in the sense it names, for the"
        " Markov chain of [switching]; a rate is that of E|e|, or of the root of E|e|^2.",
        refuted="The chain has modes that it never leaves, in which no pinned agent reaches the agents named.",
        source="Beyond the paper; theory, Switching beyond a common V, and Schedules.",
    ),
    Kind(
        id="safety",
        topic="graphs",
        role="safety",
        name="Safety for every graph",
        decides="whether the box of starts is never left, whatever graph the agents have while they move",
        title="No agent leaves the box, whatever the graph",
        statement=r"h_{ij} \text{ nondecreasing on } |y| \le 2\rho,\ k_i \ge 0 \;\Rightarrow\; V = \max_i |e_i| +"
        r" \kappa E \text{ never grows while } V \le \rho",
        plain="couplings rise on |y| <= 2 rho and gains are >= 0: V = max |e_i| + kappa E never grows while V <= rho",
        proved="For every graph with couplings and arcs of any weights, every switching and every motion, no error"
        " leaves the box; with a rate, which needs a pin on every agent, all agents reach the target.",
        refuted="Never: that it is not shown does not mean that the box is left.",
        source="Theory, Schedules: what v = 1 says.",
    ),
    Kind(
        id="settling",
        topic="schedule",
        role="settling",
        name="Settling time",
        decides="whether |e| stays within a tolerance from a given time on, by a box that moves with time and a"
        " certificate near the target",
        title="A settling time, by moving boxes",
        statement=r"\sum_j w_{ij} \sup_{-(l_j + u_i) \le y \le u_j - u_i} h_{ij}(y) - k_i u_i + c \le u_i'",
        plain="sum_j w_ij sup {h_ij(y): -(l_j + u_i) <= y <= u_j - u_i} - k_i u_i + c <= u_i'",
        proved="At every time the network pushes the faces of the box inwards at least as fast as they move, and the"
        " last box lies in the level set of a certificate: from every start in the box |e| stays below the tolerance"
        " from that time on.",
        refuted="Never: that no box is found does not exclude a shorter time.",
        source="Theory, Settling times.",
    ),
    Kind(
        id="accuracy",
        topic="accuracy",
        role="plant",
        name="Final accuracy",
        decides="how far from the target the agents may end under the disturbance, drift and measurement noise of"
        " [uncertainty]",
        title="Final bounds of the error, agent by agent",
        statement=r"\textstyle\sum_j \sup h_{ij} - k_i s v_i + b_i \le -\alpha s v_i\quad \text{for all } s \in"
        r" [s^*, \rho],\ i,\ \sigma",
        plain="on the faces e_i = +-s v_i of the box |e_j| <= s v_j: e_i' points inwards although b_i acts on it, for"
        " all s in [s*, rho], every agent and mode; b_i from the peak gains of the observer",
        proved="Every start of the domain ends with |e_i| <= bounds_i whatever acts within [uncertainty], for arbitrary"
        " switching, and stays in the box of the first stage on the way.",
        refuted="Never: that no bounds are found does not mean that there are none.",
        source="Theory, What the model leaves out.",
    ),
)

KINDS: Final[dict[str, Kind]] = {kind.id: kind for kind in _ROWS}


def ids_of(*roles: Role) -> tuple[str, ...]:
    """The ids of the checks with one of these roles, in the order in which they are tried."""
    return tuple(kind.id for kind in _ROWS if kind.role in roles)
