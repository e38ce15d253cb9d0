"""What every energy backend offers, and the problem that it evaluates."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

from services.mocap.energy.cost import Cost
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats

Energy: TypeAlias = Callable[[Floats], Floats]
"""A problem's energies (N,) in pixels of the parameter values (N, d)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """One sub-problem: its parameters, the segments that they move, and the input to compare with."""

    base_pose: Floats
    """(D,) the pose whose other parameters stay."""
    dofs: tuple[int, ...]
    """The d parameters that vary."""
    segments: tuple[int, ...]
    """The segments that are drawn at every evaluation."""
    picture: Picture
    """The input, with the pre-render of the other segments among its ignored pixels."""
    cost: Cost = field(default_factory=Cost)
    """What its differing pixels cost."""
    detail_px: float = 0.0
    """Segments may be drawn from thinned meshes whose silhouettes are off by no more than this, in pixels of
    the picture's region; 0: from their full ones. Backends that gain nothing by it draw the full ones."""

    def poses(self, values: Floats) -> Floats:
        """Complete parameter values (N, d) to poses (N, D)."""
        poses = self.base_pose[None].repeat(len(values), axis=0)
        poses[:, self.dofs] = values
        return poses


class Backend(Protocol):
    """Something that draws a body's silhouettes and counts where they differ from the input."""

    @property
    def name(self) -> str:
        """Short name, as in run.json and on the command line."""
        ...

    def energy(self, problem: Problem) -> Energy:
        """Prepare a problem; at the default cost: popcount((input XOR model) AND NOT ignored)."""
        ...

    def coverage(
        self, poses: Floats, segments: tuple[int, ...], region: Region, detail_px: float = 0.0
    ) -> Bytes:
        """Draw segments of poses (N, D) in a region: bit-planes (N, P, h, w); detail_px as in Problem."""
        ...

    def close(self) -> None:
        """Release the backend's resources."""
        ...
