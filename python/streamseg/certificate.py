"""What a run could prove: how many of its decisions depend on nothing that was not loaded."""

from __future__ import annotations

from typing import NamedTuple


class Certificate(NamedTuple):
    """What a run could prove.

    If nothing is undecided or early, and the run promised as much (`Stream.is_identical`: its spans are wide enough),
    the streamed partition is the static one; `Stream.is_proven` says both.
    """

    decided_edges: int
    """Pairs of points decided; a pair counts in each window that decides it."""
    undecided_edges: int
    """Pairs of points that could not be decided: all that they depend on never came together."""
    decided_points: int
    """Points decided, by their features or neighbors; a point counts in each window that decides it."""
    undecided_points: int
    """Points that went out of scope before any window could decide them."""
    returned_points: int
    """Points of earlier windows brought back to be looked at again; a point counts each time."""
    waited_points: int
    """Points kept until their surroundings had come, beyond the span in which they came."""
    early_decisions: int
    """Points decided though more of the cloud could still come to where they are."""
    most_waiting: int
    """Points that waited at the same time, at the most."""

    @property
    def is_complete(self) -> bool:
        """Whether nothing was left undecided, and nothing decided too early."""
        return not (self.undecided_edges or self.undecided_points or self.early_decisions)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What stands between the run and proof, a sentence each, and what to do; none if it is complete."""
        kinds = (
            (
                self.undecided_edges,
                "edges could not be decided: no empty circle through their ends was ever loaded whole",
            ),
            (
                self.undecided_points,
                "points went out of scope before any window held all that decides about them; "
                "use wider spans, or limit how far away neighbors can be",
            ),
            (
                self.early_decisions,
                "decisions about points were early, as more of the cloud could still come to where they are; "
                "use spans by width, or revisit=True with a file or an array",
            ),
        )
        return tuple(f"{count:,} {sentence}" for count, sentence in kinds if count)

    def __str__(self) -> str:
        edges = self.decided_edges + self.undecided_edges
        points = self.decided_points + self.undecided_points
        counts = (
            (edges, f"{self.undecided_edges:,} edges undecided in {edges:,} decisions"),
            (points, f"{self.undecided_points:,} points undecided in {points:,} decisions"),
            (self.returned_points, f"{self.returned_points:,} points returned"),
            (self.waited_points, f"{self.waited_points:,} points waited, {self.most_waiting:,} at a time"),
            (self.early_decisions, f"{self.early_decisions:,} early decisions"),
        )
        return ", ".join(told for count, told in counts if count) or "nothing to count"
