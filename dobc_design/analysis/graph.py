"""Who hears whom, directly and through others: graph facts of one mode (section 2 of the paper).

Edges run with the information, from speaker to listener.  The facts about reachability, components and
balance are exact, but a verdict never rests on this module: see ``conditions.consensus.network``.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.problem.network import Arcs, Network
from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphFacts:
    """Facts of one mode, agents by label in the order of the network.

    ``unreached``: agents that no pinned agent reaches.  ``components``: the strongly connected components,
    ordered by their first agent.  ``sources``: those of them that hear nobody outside; unless each has a pinned
    agent, somebody is unreached.  ``balanced``: every agent hears as much weight as it sends, exactly.
    ``heard`` and ``hearing`` count, per agent, whom it hears and who hears it.
    """

    mode: str
    arcs: int
    unreached: tuple[str, ...]
    components: tuple[tuple[str, ...], ...]
    sources: tuple[tuple[str, ...], ...]
    balanced: bool
    heard: tuple[int, ...]
    hearing: tuple[int, ...]

    @property
    def is_strongly_connected(self) -> bool:
        """Whether everybody reaches everybody."""
        return len(self.components) == 1

    def __str__(self) -> str:
        reached = f"not reached: {', '.join(self.unreached[:10])}" if self.unreached else "all agents reached"
        if len(self.unreached) > 10:
            reached += f" and {len(self.unreached) - 10} more"
        return (
            f'mode "{self.mode}": {self.arcs} arcs, {len(self.components)} strongly connected component(s),'
            f" {'balanced' if self.balanced else 'not balanced'}, {reached}"
        )


def graph_facts(problem: Problem, mode: str) -> GraphFacts:
    """Collect the graph facts of one mode.  An agent counts as pinned if its gain is not zero.

    Raises: KeyError if there is no such mode.
    """
    import networkx as nx

    arcs = problem.network.modes[mode]
    labels = problem.network.labels
    graph = information_graph(problem.network, mode)
    components = sorted(sorted(part) for part in nx.strongly_connected_components(graph))
    return GraphFacts(
        mode=mode,
        arcs=len(arcs),
        unreached=_labels(_unreached(graph, problem.pinning.agents), labels),
        components=tuple(_labels(part, labels) for part in components),
        sources=tuple(_labels(part, labels) for part in components if _hears_nobody_outside(graph, part)),
        balanced=_is_balanced(arcs),
        heard=tuple(degree for _, degree in graph.in_degree(range(len(labels)))),
        hearing=tuple(degree for _, degree in graph.out_degree(range(len(labels)))),
    )


def information_graph(network: Network, mode: str) -> Any:
    """Return a networkx.DiGraph of agent indices with an edge from every speaker to its listener, 'weight' included."""
    import networkx as nx

    graph = nx.DiGraph()
    graph.add_nodes_from(range(network.size))
    arcs = network.modes[mode]
    graph.add_weighted_edges_from((speaker, listener, weight) for listener, speaker, weight in arcs)
    return graph


def _unreached(graph: Any, pinned: tuple[int, ...]) -> list[int]:
    reached = set(pinned)
    waiting = list(pinned)
    while waiting:
        fresh = [listener for listener in graph.successors(waiting.pop()) if listener not in reached]
        reached.update(fresh)
        waiting.extend(fresh)
    return [agent for agent in graph if agent not in reached]


def _hears_nobody_outside(graph: Any, part: list[int]) -> bool:
    inside = set(part)
    return all(speaker in inside for agent in part for speaker in graph.predecessors(agent))


def _is_balanced(arcs: Arcs) -> bool:
    surplus: defaultdict[int, Fraction] = defaultdict(Fraction)
    for listener, speaker, weight in arcs:
        surplus[listener] += weight
        surplus[speaker] -= weight
    return not any(surplus.values())


def _labels(agents: list[int], labels: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(labels[agent] for agent in agents)
