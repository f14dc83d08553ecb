"""An oracle for the regional checks of a certificate, written from the page of the format.

It reads problem.json and certificate.json as JSON.  Suprema come from end points and turning points
at many sizes s, the worst of them decided by mpmath at 200 bits; matrices over flint's rationals.
What it calls false is false, up to what 200 bits leave; what it misses is wrong by less than its
samples can see (tests show that 1e-6 is seen).
"""

import base64
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
from couplings import BITS
from scipy import optimize

from oracles.couplings import (
    FINE,
    Curve,
    curve,
    diagonal,
    exact,
    field_part,
    fmpq,
    is_linear,
    mp,
    positive,
    rational,
)
from oracles.quadratic import Quadratic
from oracles.settling import false_settling

IDS = (
    "max-separable",
    "delay",
    "sampling",
    "lure",
    "settling",
    "equilibrium",
    "tolerance",
    "actuators",
)
COVERING = ("max-separable", "lure")
NEAR_0 = np.geomspace(1e-5, 1, 40)
EVERYWHERE = np.linspace(0.01, 1, 100)
NEAR_1 = 1 - np.geomspace(1e-6, 0.1, 12)
SIZES = np.unique(np.concatenate([NEAR_0, EVERYWHERE, NEAR_1]))
FEW_SIZES = np.array([1e-3, 0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0])
ROOM = 1e-9  # what floats leave before mpmath is asked
UNREADABLE = (
    KeyError,
    TypeError,
    ValueError,
    IndexError,
    AttributeError,
    ZeroDivisionError,
    AssertionError,
)


class Regions:
    """What is true of the regional checks of one problem (``document``: problem.json)."""

    def __init__(self, document: dict[str, Any], W: Any) -> None:
        self.document = document
        self.W = W
        self.n = len(document["labels"])
        self.m = document["dimension"]
        # with w < 0 the function is h(-e_j - e_i): e_j of either sign is as large
        self.modes = {
            mode["name"]: [(i, j, abs(exact(w))) for i, j, w in mode["arcs"]]
            for mode in document["modes"]
        }
        arcs = (arc for mode in document["modes"] for arc in mode["arcs"])
        #: Whether some w are negative.  Sides are not looked for: only rows of boxes with equal
        #: faces are judged, which are the same with and without sides.
        self.signed = any(exact(w) < 0 for _, _, w in arcs)
        listed = document["coupling"]["exceptions"]
        special = {tuple(item["arc"]): item["h"] for item in listed}
        self.default = document["coupling"]["h"]
        self.special = list(special.values())
        modes = self.modes.values()
        self.h = {(i, j): special.get((i, j), self.default) for arcs in modes for i, j, _ in arcs}
        couplings = (self.default, *self.special)
        self.by_component = all(isinstance(h, str) for h in couplings)
        self.gains = {i: [[exact(x) for x in row] for row in k] for i, k in document["gains"]}
        self.K = np.zeros((self.n, self.m, self.m))
        for i, k in self.gains.items():
            self.K[i] = [[float(x) for x in row] for row in k]
        exosystem = document["exosystem"]
        self.A = None if exosystem is None else rational(exosystem["A"])
        self.C = None if exosystem is None else rational(exosystem["C"])
        self.F = None if self.A is None or W is None else self.A - rational(W) * self.C
        self.errors = (Fraction(0), Fraction(0))  # of weights and gains, relative
        # Of each agent: its first row of C and its own states, where agents have different
        # exosystems.
        order = 0 if self.A is None else self.A.nrows()
        all_states = (0, list(range(order)))
        default_owner = [all_states] * self.n
        self.own = (exosystem or {}).get("own", default_owner)

    def held(self, i: int) -> Fraction:
        """The least of k_cc - sum over d != c of |k_cd|, every entry off by the error of the
        gains."""
        k = self.gains.get(i, [[Fraction(0)]])
        off = self.errors[1]
        least = []
        for c, row in enumerate(k):
            beside = sum(map(abs, row)) - abs(row[c])
            size = abs(row[c])
            least.append(row[c] - off * size - beside * (1 + off))
        return min(least)

    def linear(self, arc: tuple[int, int], c: int) -> bool:
        """Whether component c of what the arc says is a polynomial of degree 1 at most."""
        h = self.h[arc]
        return is_linear(h if isinstance(h, str) else h[c])

    def all_linear(self) -> bool:
        """Whether every coupling of the problem, used or not, is linear."""
        texts = [self.default, *self.special]
        return all(is_linear(text) for h in texts for text in ([h] if isinstance(h, str) else h))

    def false(self, check: dict[str, Any], document: dict[str, Any], domain: str) -> list[str]:
        """Why the check is not true; empty if no sample contradicts it.  ``domain``: that of Lemma
        1."""
        try:
            with np.errstate(all="ignore"), mpmath.workprec(BITS):
                return self._false(check, document, domain)
        except UNREADABLE as error:
            return [f"unreadable: {error!r}"]

    def _false(self, check: dict[str, Any], document: dict[str, Any], domain: str) -> list[str]:
        id = check["id"]
        verdict = check["verdict"]
        if check["margin"] is not None or check.get("mode") is not None:
            return ["margin or mode"]
        if verdict != "proved" and check["domain"] != domain:
            return ["domain"]
        if verdict == "undecided":
            claims = [check["rate"], check.get("exact"), check.get("witness")]
            if claims == [None] * 3:
                return []
            return ["claims of an undecided check"]
        if self.A is not None and self.W is None:
            return ["no W"]
        if id == "tolerance" and "v" in check["exact"]:
            return self._tolerance(check, check["exact"]["v"], domain)
        if id == "equilibrium":
            return self._equilibrium(check)
        if self.signed and (verdict == "refuted" or id == "lure"):
            return ["signs"]
        if verdict == "refuted":
            if id == "max-separable":
                return self._stuck(check)
            return ["nothing refutes this"]
        if check.get("witness") is not None or not self._domain_is_one(check["domain"]):
            return ["witness or domain"]
        if id == "lure":
            return Quadratic(self, check["exact"]).false(check, domain)
        if not self.by_component:
            return ["no rows"]
        if id == "settling":
            return false_settling(self, check)
        proof = next(
            (
                c
                for c in document["checks"]
                if c["id"] == "max-separable" and c["verdict"] == "proved"
            ),
            None,
        )
        if proof is None or proof["domain"] != check["domain"]:
            return ["no proof beside it"]
        if id == "max-separable":
            return self._separable(check, domain)
        if id == "tolerance":
            return self._tolerance(check, proof["exact"]["v"], domain, proof["exact"])
        if id == "actuators":
            return self._inputs(check, proof["exact"], domain)
        if id == "delay":
            return self._delay(check["exact"], check["rate"], proof["exact"])
        own = check["exact"].get("certificate", proof["exact"])
        rate, wrong = (
            (Fraction(1), [])
            if own is proof["exact"]
            else self._holding(own, check["domain"], domain)
        )
        return wrong or (
            ["rate"] if rate <= 0 else self._sampling(check["exact"], check["rate"], own)
        )

    def _domain_is_one(self, domain: Any) -> bool:
        if domain == "global":
            return True
        R, s = (Fraction(repr(domain[name])) for name in ("radius", "disturbance"))
        return (
            R > 0
            and s >= 0
            and (s == 0 or self.A is not None)
            and domain["kind"] in ("box", "ball")
        )

    def covers(self, check: dict[str, Any]) -> bool:
        """Whether the domain of a check holds all starts of the region."""
        region = self.document["region"]
        domain = check["domain"]
        if region is None or domain == "global":
            return bool(domain == "global")
        pairs = [[exact(x) for x in pair] for pair in region["initial_states"]]
        reach = []
        for c, (lo, hi) in enumerate(pairs):
            sides = max(max(abs(lo - g[c]), abs(hi - g[c])) for g in self.goals())
            reach.append(sides)
        R = Fraction(repr(domain["radius"]))
        s = Fraction(repr(domain["disturbance"]))
        if domain["kind"] == "box":
            inside = max(reach) <= R
        else:
            inside = self.n * sum(r * r for r in reach) <= R**2
        return inside and s >= exact(region["initial_disturbance"] or 0)

    def goals(self) -> list[list[Fraction]]:
        goals = []
        for _ in range(self.n):
            goals.append([exact(x) for x in self.document["target"]])
        for i, offset in self.document["offsets"]:
            pairs = zip(goals[i], offset, strict=True)
            goals[i] = [x + exact(o) for x, o in pairs]
        return goals

    # rows

    def vector(self, v: Any) -> list[Fraction]:
        if isinstance(v, dict):
            raw = base64.b64decode(v["float64"])
            numbers = np.frombuffer(raw, dtype="<f8")
            v = [Fraction(float(x)) for x in numbers]
        values = [exact(x) for x in v]
        if len(values) != self.n or min(values) <= 0:
            raise ValueError("v")
        return values

    def false_rows(
        self, v: list[Fraction], *, rho: Fraction, alpha: Fraction, stretch: Any = 1
    ) -> bool:
        """Whether a row is above 0 for some s in (0, rho]."""
        share, excess, mode, face, i = self._worst(v, SIZES, rho, alpha, stretch)
        step = 0.02
        for _ in range(3 if excess > -1e-3 else 0):
            stretched = 1 + step * np.linspace(-1, 1, 41)
            near = np.clip(share * stretched, 1e-6, 1.0)
            share, excess, mode, face, i = self._worst(v, near, rho, alpha, stretch)
            step /= 15
        if excess < -ROOM:
            return False
        level = mp(Fraction(share)) * mp(rho)
        where = (mode, face, i)
        total, size = self._true_row(v, level, alpha, mp(stretch), where)
        return bool(not mpmath.isfinite(total) or total > mp(FINE) * size)

    def _worst(
        self, v: Any, sizes: Any, rho: Fraction, alpha: Fraction, stretch: Any
    ) -> tuple[Any, ...]:
        """The s / rho, the relative excess, mode, face and agent of the worst row, in floats."""
        s = float(rho) * sizes
        u = [float(x) for x in v]
        theta = float(stretch)
        found: tuple[Any, ...] = (1.0, -np.inf, "", 1, 0)
        for mode, arcs in self.modes.items():
            for face in (1, -1):
                held = [s * float((self.held(i) - alpha) * v[i]) for i in range(self.n)]
                total = -np.array(held)
                size = np.abs(total) + 1e-300
                for i, j, w in arcs:
                    part = self._arc(i, j, v)
                    low = -s * (u[i] + theta * u[j])
                    high = s * (theta * u[j] - u[i])
                    turning = part[1] * float(rho) * theta
                    turns = part[0].turns(turning)
                    values = part[0].highest(low, high, face, turns)
                    relative = float(self.errors[0])
                    total[i] += float(w) * (values + relative * np.abs(values))
                    size[i] += float(w) * np.abs(values)
                excess = np.where(np.isfinite(total), total / size, np.inf)
                i, k = np.unravel_index(int(np.argmax(excess)), excess.shape)
                if excess[i, k] > found[1]:
                    row = float(sizes[k])
                    found = (row, float(excess[i, k]), mode, face, int(i))
        return found

    def _arc(self, i: int, j: int, v: Any) -> tuple[Curve, float]:
        return curve(self.h[i, j]), 2.0 * float(max(v))

    def _true_row(
        self, v: Any, s: Any, alpha: Fraction, theta: Any, row: tuple[str, int, int]
    ) -> tuple[Any, Any]:
        mode, face, agent = row
        pull = self.held(agent) - alpha
        held = pull * v[agent]
        total = -mp(held) * s
        size = abs(total)
        for i, j, w in self.modes[mode]:
            if i == agent:
                far = theta * mp(v[j])
                reach = mp(v[i]) + far
                lo = -s * reach
                hi = s * (theta * mp(v[j]) - mp(v[i]))
                part, scale = self._arc(i, j, v)
                near = part.turns(scale * float(s) * float(theta))
                value = mp(w) * part.truly_highest(lo, hi, face, near)
                value += mp(self.errors[0]) * abs(value)
                total = total + value
                size = size + abs(value)
        return total, size

    # checks

    def rate_of(self, e: dict[str, Any], v: list[Fraction]) -> Fraction:
        """The rate of V; raises where the rows or the conditions on P, beta, kappa and size do not
        hold."""
        alpha = exact(e["alpha"])
        rho = Fraction(1) if e["rho"] is None else exact(e["rho"])
        if alpha <= 0 or rho <= 0 or self.false_rows(v, rho=rho, alpha=alpha):
            raise ValueError("rows")
        if self.A is None:
            return alpha
        beta = exact(e["beta"])
        kappa = exact(e["kappa"])
        if self.false_observer(e) or kappa <= 0 or kappa * beta * min(v) <= 1:
            raise ValueError("kappa")
        return min(alpha, beta - 1 / (kappa * min(v)))

    def false_observer(self, e: dict[str, Any]) -> list[str]:
        """What is wrong with P, beta and size."""
        P = rational(e["P"])
        (beta, size) = (exact(e[name]) for name in ("beta", "size"))
        lyapunov = self.F.transpose() * P
        decay = lyapunov + P * self.F + 2 * fmpq(beta) * P
        size_matrix = [fmpq(size)] * P.nrows()
        held = [diagonal(size_matrix) - P, -decay]
        for c in self.C.tolist():
            column = rational([[str(x)] for x in c])
            held.append(P - column * column.transpose())
        right = min(beta, size) > 0 and positive(P, strict=True)
        if right and all(positive(X, strict=False) for X in held):
            return []
        return ["P"]

    def _separable(self, check: dict[str, Any], domain: str) -> list[str]:
        rate, wrong = self._holding(check["exact"], check["domain"], domain)
        return wrong or ([] if 0 < Fraction(repr(check["rate"])) <= rate else ["rate"])

    def _holding(self, e: dict[str, Any], place: Any, domain: str) -> tuple[Fraction, list[str]]:
        """The rate of V, and why the starts of ``place`` are not all inside; raises where the rows
        do not hold."""
        v = self.vector(e["v"])
        without_size = (e["rho"] is None) != (place == "global")
        if without_size or (e["rho"] is None and domain != "global"):
            return Fraction(0), ["rho"]
        rate = self.rate_of(e, v)
        if e["rho"] is not None:
            level = exact(e["rho"])
            rho, R, s = (
                level,
                *(Fraction(repr(place[name])) for name in ("radius", "disturbance")),
            )
            left = rho - R / min(v)
            if place["kind"] != "box" or left < 0:
                return rate, ["the box"]
            if self.A is not None and (exact(e["kappa"]) * s) ** 2 * exact(e["size"]) > left**2:
                return rate, ["the disturbance"]
        return rate, []

    def _delay(self, e: dict[str, Any], rate: Any, proof: dict[str, Any]) -> list[str]:
        v = self.vector(proof["v"])
        b = exact(e["rate"])
        T = exact(e["delay"])
        if (
            T < 0
            or not 0 < Fraction(repr(rate)) <= b
            or (self.A is not None and b > exact(proof["beta"]))
        ):
            return ["rate"]
        rho = Fraction(1) if proof["rho"] is None else exact(proof["rho"])
        growth = mpmath.exp(mp(b * T))
        if self.false_rows(v, rho=rho, alpha=b, stretch=growth):
            return ["rows"]
        return []

    def _sampling(self, e: dict[str, Any], rate: Any, proof: dict[str, Any]) -> list[str]:
        """The largest |e_ic| one period later, from any point of any box, against f s v_i."""
        T = exact(e["period"])
        f = exact(e["factor"])
        alpha = exact(proof["alpha"])
        if T <= 0 or not 1 - T * alpha <= f < 1 or rate is not None:
            return ["period, factor"]
        v = self.vector(proof["v"])
        rho = Fraction(1) if proof["rho"] is None else exact(proof["rho"])
        u = np.array([float(x) for x in v])
        period = float(T)
        rest = []
        for k in self.K:
            beside = [sum(abs(x) for d, x in enumerate(row) if d != c) for c, row in enumerate(k)]
            rest.append(beside)
        for s in float(rho) * FEW_SIZES:
            for arcs in self.modes.values():
                for face in (1, -1):
                    ends = s * u[:, None] * np.linspace(-1, 1, 201)  # where e_ic may be
                    drive = np.zeros_like(ends)
                    for i, j, w in arcs:
                        part, scale = self._arc(i, j, v)
                        turns = part.turns(scale * float(rho))
                        lower = -s * u[j] - ends[i]
                        upper = s * u[j] - ends[i]
                        felt = part.highest(lower, upper, face, turns)
                        drive[i] += float(w) * felt
                    for c in range(self.m):
                        held = self.K[:, c, c][:, None]
                        after = ends + period * (drive - held * ends)
                        step = period * s * u[:, None]
                        shares = np.array([row[c] for row in rest])[:, None]
                        after += step * shares
                        allowed = s * u[:, None] * (float(f) + ROOM)
                        if np.any(after > allowed):
                            return ["a step overshoots"]
        return []

    def _tolerance(
        self, check: dict[str, Any], v: Any, domain: str, base: dict[str, Any] | None = None
    ) -> list[str]:
        """The rows with every weight and gain at its worse end: those of ``base``, or at a target
        without kinks."""
        e = check["exact"]
        given = self.document.get("uncertainty") or {}
        self.errors = exact(e["weights"]), exact(e["gains"])
        try:
            alpha = exact(e["alpha"])
            v = self.vector(v)
            rate = Fraction(repr(check["rate"] or 0.0))
            rho = Fraction(1, 10**9) if base is None else exact(base["rho"] or 1)
            fails = alpha <= 0 or self.false_rows(v, rho=rho, alpha=alpha)
        finally:
            nothing = (Fraction(0), Fraction(0))
            (weights, gains), self.errors = self.errors, nothing
        if (
            fails
            or not 0 <= weights < 1
            or weights < exact(given.get("weights") or 0)
            or rate < 0
            or check.get("witness")
        ):
            return ["rows, errors or rate"]
        if (
            gains >= 1
            or gains < exact(given.get("gains") or 0)
            or ("eta" in e) is given.get("known_to_agents", True)
        ):
            return ["errors or eta"]
        if base is None:
            said = check["domain"] == domain and (check["rate"] is None) is (self.A is not None)
            if said and rate <= alpha and "eta" not in e:
                return []
            return ["domain or rate"]
        if self.A is None:
            return [] if 0 < rate <= alpha else ["rate"]
        margin = e.get("eta", "0")
        texts = (margin, base["beta"], base["kappa"])
        eta, beta, kappa = (exact(x) for x in texts)
        if "eta" in e and eta < self._pull(v, rho, base) * weights * (1 - Fraction(1, 10**6)):
            return ["eta"]
        if 0 < rate <= min(alpha - kappa * eta, beta - 1 / (kappa * min(v))):
            return []
        return ["rate"]

    def _pull(self, v: list[Fraction], rho: Fraction, base: dict[str, Any]) -> Fraction:
        """max |W|_P sum_j w (v_i + v_j) sup |h(y)/y| over the modes and agents, from samples of
        y."""
        P = floats(base["P"])
        W = floats(self.W)
        roots = np.sqrt(np.einsum("ak,ab,bk->k", W, P, W))
        most = 0.0
        starts = range(0, len(roots), self.m)
        norm = max(sum(roots[k : k + self.m]) for k in starts)
        for arcs in self.modes.values():
            for agent in range(self.n):
                lone = 0.0
                for i, j, w in arcs:
                    if i == agent:
                        reach = float(rho * (v[i] + v[j]))
                        points = np.concatenate([-SIZES, SIZES])
                        y = reach * points
                        values = curve(self.h[i, j]).fast(y)
                        quotients = np.abs(values / y)
                        steepest = np.max(quotients)
                        lone += float(w * (v[i] + v[j])) * steepest
                most = max(most, lone)
        return Fraction(float(norm * most))

    def _inputs(self, check: dict[str, Any], base: dict[str, Any], domain: str) -> list[str]:
        """u_i = -K_i e_i - d_i + C eps_i on {N + kappa E <= rho}, with E at most its start, unless
        errors of weights act on it, and with the largest disturbance that is given.  A box of its
        own is not judged here."""
        e = check["exact"]
        table = self.document["actuators"]
        plant = self.document.get("uncertainty") or {}
        if "v" in e:
            return []
        v = self.vector(base["v"])
        rho = exact(e["rho"])
        off = exact(plant.get("gains") or 0)
        claim = {**base, "rho": e["rho"]}
        _, wrong = self._holding(claim, check["domain"], domain)
        if (
            wrong
            or check["rate"] is not None
            or rho > exact(base["rho"] or rho)
            or table["amplitude"] is None
        ):
            return wrong or ["rate, rho or amplitude"]
        for i, label in enumerate(self.document["labels"]):
            rows_of_gain = self.gains.get(i, [[0]])
            rows = [sum(map(abs, row)) for row in rows_of_gain]
            size = v[i] * max(rows, default=0) * (1 + off)
            if not isinstance(table["limit"], dict):
                limit = table["limit"]
            else:
                limit = table["limit"].get(label)
            most = exact(e["inputs"][label])
            left = most - size * rho - exact(table["amplitude"])
            above = limit is not None and most > exact(limit)
            if above or not self._has_room(
                left, size, rho, base, check["domain"], plant.get("known_to_agents", True)
            ):
                return [f"the input of agent {label}"]
        return []

    def _has_room(
        self,
        left: Fraction,
        size: Fraction,
        rho: Fraction,
        base: dict[str, Any],
        box: Any,
        known: bool,
    ) -> bool:
        """Whether ``left`` holds (1 - kappa |k| v) E0, E0 = s sqrt(size), or rho/kappa."""
        if left < 0 or self.A is None:
            return left >= 0
        part = max(Fraction(0), 1 - exact(base["kappa"]) * size)
        if not known:
            return bool(left >= part * rho / exact(base["kappa"]))
        disturbance = Fraction(repr(box["disturbance"]))
        allowed_square = part**2 * disturbance**2
        return bool(left**2 >= allowed_square * exact(base["size"]))

    def _stuck(self, check: dict[str, Any]) -> list[str]:
        witness = check["witness"]
        labels = self.document["labels"]
        group = {labels.index(label) for label in witness.get("labels") or []}
        blocked = all(self.held(i) <= 0 and self._hears_only(group, i) for i in group)
        said = witness["kind"] == "agents" and check["rate"] is None
        said = said and check.get("exact") is None
        if group and blocked and said and self.by_component:
            return []
        return ["agents"]

    def _hears_only(self, group: set[int], agent: int) -> bool:
        """Whether in some mode the agent hears nobody beside the group."""
        modes = self.modes.values()
        return any(group >= {j for a, j, _ in arcs if a == agent} for arcs in modes)

    def _equilibrium(self, check: dict[str, Any]) -> list[str]:
        """A root, found by Newton's method from the middle, that lies in the box, which lies in the
        region."""
        e = check["exact"]
        shape = (self.n, self.m)
        box = [[exact(x) for x in pair] for pair in e["box"]]
        if (
            check["verdict"] != "refuted"
            or check["rate"] is not None
            or any(lo >= hi for lo, hi in box)
        ):
            return ["verdict, rate or box"]
        around_zero = all(lo <= 0 <= hi for lo, hi in box)
        if around_zero or len(box) != self.n * self.m:
            return ["the box holds the target"]
        if self.document["region"] is not None:
            given = self.document["region"]["initial_states"]
            pairs = [[exact(x) for x in pair] for pair in given]
            for k, (lo, hi) in enumerate(box):
                goal = self.goals()[k // self.m][k % self.m]
                outside_below = lo + goal < pairs[k % self.m][0]
                if outside_below or hi + goal > pairs[k % self.m][1]:
                    return ["the box leaves the region"]
        middle = np.array([float(sum(pair) / 2) for pair in box])
        found = optimize.fsolve(
            lambda x: self.field(e["mode"], x.reshape(shape)).ravel(), middle, xtol=1e-14
        )
        values = self.field(e["mode"], found.reshape(shape))
        rest = np.abs(values).max()
        width = max(float(hi - lo) for lo, hi in box)
        sides = zip(found, box, strict=True)
        inside = all(float(lo) - 1e-12 <= x <= float(hi) + 1e-12 for x, (lo, hi) in sides)
        if rest < 1e-9 * (1 + width) and inside:
            return []
        return ["no equilibrium there"]

    def field(self, mode: str, e: Any) -> Any:
        """h(e) - K e for an array of shape (n, m, ...)."""
        total = -np.einsum("iab,ib...->ia...", self.K, e)
        for i, j, w in self.modes[mode]:
            h = self.h[i, j]
            y = e[j] - e[i]
            part = curve(h).fast if isinstance(h, str) else field_part(tuple(h))[0]
            total[i] += float(w) * part(y)
        return total


def floats(rows: Any) -> Any:
    numbers = [[float(exact(str(x))) for x in row] for row in rows]
    return np.array(numbers)
