"""What the mesh needs of a condensed gear body, whoever condensed it."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Condensed(Protocol):
    """What is needed of a condensed body; `fem_prep.ReducedBody` is one.

    Its coordinates are three translations of every rim node, then six displacements of every seat,
    then the rest; z is the axis and z = 0 mid-face, x points towards the middle of tooth 0.
    """

    @property
    def name(self) -> str:
        """Of the body."""
        ...

    @property
    def stiffness(self) -> np.ndarray:
        """Of its coordinates, `[dof, dof]` [SI]."""
        ...

    @property
    def mass(self) -> np.ndarray:
        """Of its coordinates, `[dof, dof]` [SI]."""
        ...

    @property
    def coriolis(self) -> np.ndarray | None:
        """Of its coordinates per speed, factor 2 included, `[dof, dof]` [SI], or `None`."""
        ...

    @property
    def spin_softening(self) -> np.ndarray | None:
        """What its stiffness loses per square of the speed, `[dof, dof]` [SI], or `None`."""
        ...

    @property
    def stress_stiffening(self) -> np.ndarray | None:
        """What its stiffness gains per square of the speed, `[dof, dof]` [SI], or `None`."""
        ...

    @property
    def centrifugal_load(self) -> np.ndarray:
        """On its coordinates per square of the speed, `[dof]` [SI]."""
        ...

    @property
    def rim_nodes(self) -> np.ndarray:
        """Places of the rim nodes, `[rim, 3]` [m]."""
        ...

    @property
    def rim_faces(self) -> np.ndarray:
        """Rim nodes of the elements of the rim, `[face, 8]`."""
        ...

    @property
    def nodes(self) -> np.ndarray:
        """Places of the nodes of its grid, `[node, 3]` [m]; empty if not known."""
        ...

    @property
    def interior_shapes(self) -> np.ndarray:
        """Displacements of the grid for each of its last coordinates, `[interior, node, 3]` [SI];
        empty if not known."""
        ...

    @property
    def seats(self) -> tuple[str, ...]:
        """Names of the seats."""
        ...

    @property
    def seat_points(self) -> np.ndarray:
        """Places of the seats, `[seat, 3]` [m]."""
        ...

    @property
    def facts(self) -> Mapping[str, object]:
        """What else is known: `sectors`, equal ones that the body repeats in."""
        ...
