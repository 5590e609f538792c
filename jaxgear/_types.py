"""Array aliases, and the glossary of axes that every annotation uses.

| axis | meaning |
|---|---|
| `body` | pinion, wheel |
| `phase` | position within a cycle of one or more mesh periods |
| `line` | contact line, one per tooth pair that can be in contact at a phase |
| `slice` | thin slice across the face |
| `cell` | piece of a contact line: `line` times `slice`, flattened |
| `tooth` | tooth of a gear |
| `neighbour` | tooth, counted from a loaded one |
| `column` | right-hand side of a system of equations |
| `load` | force of a cell, or resultant on a mesh coordinate |
| `coordinate` | mesh coordinate: approach along the normal, tilt about the normal's axis |
| `dof` | degree of freedom of the two bodies: u_S u_T u_Z, then rotations, pinion then wheel |
| `harmonic` | order of the mesh frequency |
| `torque` | operating point |

Under a type checker an alias is a plain array; at run time (in the tests) it carries its shape.
"""

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

if TYPE_CHECKING:
    Scalar = Array
    Reals = Array
    Bodies = Array
    Phases = Array
    Slices = Array
    LineGrid = Array
    LinePhases = Array
    LineNumbers = Array
    CellNumbers = Array
    Teeth = Array
    Cells = Array
    CellGrid = Array
    CellArms = Array
    CellArmGrid = Array
    CellColumns = Array
    Loads = Array
    Coupling = Array
    CouplingGrid = Array
    DenseCouplingGrid = Array
    Influence = Array
    ShearInfluence = Array
    PlateInfluence = Array
    Coordinates = Array
    CoordinateMatrix = Array
    CoordinateColumns = Array
    CoordinateGrid = Array
    DofCoordinates = Array
    DofGrid = Array
    Harmonics = Array
    Flag = Array
    Flags = Array
    Marks = Array
    Counts = Array
else:
    Scalar = Float[Array, ""]
    Reals = Float[Array, "..."]
    Bodies = Float[Array, "body"]
    Phases = Float[Array, "phase"]
    Slices = Float[Array, "slice"]
    LineGrid = Float[Array, "phase line slice"]
    LinePhases = Float[Array, "phase line"]
    LineNumbers = Int[Array, "phase line"]
    CellNumbers = Int[Array, "phase cell"]
    Teeth = Float[Array, "tooth"]
    Cells = Float[Array, "cell"]
    CellGrid = Float[Array, "phase cell"]
    CellArms = Float[Array, "cell coordinate"]
    CellArmGrid = Float[Array, "phase cell coordinate"]
    CellColumns = Float[Array, "cell column"]
    Loads = Float[Array, "load"]
    Coupling = Float[Array, "line line slice"] | Float[Array, "cell cell"]
    CouplingGrid = Float[Array, "phase line line slice"]
    DenseCouplingGrid = Float[Array, "phase cell cell"]
    Influence = Float[Array, "neighbour displacement resultant"]
    ShearInfluence = Float[Array, "neighbour 1 1"]
    PlateInfluence = Float[Array, "neighbour 3 3"]
    Coordinates = Float[Array, "coordinate"]
    CoordinateMatrix = Float[Array, "coordinate coordinate"]
    CoordinateColumns = Float[Array, "coordinate column"]
    CoordinateGrid = Float[Array, "phase coordinate"]
    DofCoordinates = Float[Array, "dof coordinate"]
    DofGrid = Float[Array, "phase dof"]
    Harmonics = Float[Array, "harmonic"]
    Flag = Bool[Array, ""]
    Flags = Bool[Array, "phase"]
    Marks = Bool[Array, "..."]
    Counts = Int[Array, "phase"]


def as_scalar(value: object) -> Array:
    """A real number as a differentiable leaf.

    A Python float in an `eqx.Module` would get no gradient and no error, so every
    physical field passes through here.

    **Arguments:**

    - `value`: a real number or a scalar array.

    **Returns:**

    A scalar array of the default real type.
    """
    return as_reals(value)


def as_reals(value: object) -> Array:
    """Real numbers of any shape as a differentiable leaf; as `as_scalar`."""
    # Single numbers, and arrays whose type is not said, would be converted by a compiled program;
    # arrays of NumPy are only copied.
    plain = isinstance(value, float | int | np.number)
    return jnp.asarray(np.asarray(value, dtype=float) if plain else value, dtype=float)


def as_optional_scalar(value: object) -> Array | None:
    """As `as_scalar`, with `None` kept as `None`."""
    return None if value is None else as_scalar(value)
