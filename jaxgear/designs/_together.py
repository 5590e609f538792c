"""Designs of one shape in one compiled call: their mesh cycles, and derivatives by what varies.

One design after the other inside the call: side by side all would wait for the contact that takes
most steps, which is three times slower, and memory would grow with their number. Of several
devices of a process each has its share of the designs, and the program of one device: that which
the compiler makes for all of them adds in another order, and has other last digits.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._geometry._lines import MeshGrid
from jaxgear._kept_programs import USUALLY, Kind
from jaxgear._kept_programs import program_of as compiled_program
from jaxgear._solve._cycle import mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Flags, Reals
from jaxgear.designs._asked import Study
from jaxgear.designs._numbers import (
    ARRAYS,
    DEFLECTION,
    PLACES,
    TOGETHER,
    array_of,
    numbers_together,
)
from jaxgear.scene._build import couples_on_pinion, law_of, model_of
from jaxgear.scene._gear_tables import ShaftKeys
from jaxgear.scene._tables import MeshKeys
from jaxgear.study._built import BuiltScene
from jaxgear.study._derivatives import Keys, linearised
from jaxgear.study._design import keeps_teeth

_TORQUE = "pair.torque_pinion_Nm"
_ALIGNMENT = "pair.misalignment_"
# Of the phases of a period: so different shares between entry and exit are another program.
_SHARE = 8


class Shape(NamedTuple):
    """What designs have in common that go through one compiled call.

    **Fields:**

    - `grid`: phases, lines and slices.
    - `structure`: of the model: which points of shafts share nodes, and the like.
    """

    grid: MeshGrid
    structure: Any


class Found(NamedTuple):
    """What a call finds of many designs; the first axis of all is the design.

    **Fields:**

    - `numbers`: in the units of their names, the deflection of a single pair last.
    - `converged`: whether each phase was solved.
    - `arrays`: that are kept, in the units of their names.
    - `slopes`: derivatives of the numbers by the keys `[design, key, number]`, or None.
    """

    numbers: Any
    converged: Any
    arrays: tuple[Any, ...]
    slopes: Any


def goes_together(study: Study, keys: Sequence[str]) -> bool:
    """Whether what a study keeps is found of many designs in one call."""
    keep, roots = study.asked.keep, [x for x in study.asked.keep.numbers if "root_stress" in x]
    return (
        study.asked.command == "run"
        and all(name in TOGETHER for name in keep.numbers)
        and all(name in ARRAYS for name in keep.arrays)
        # Influences on roots are of given teeth.
        and (not roots or (study.scene.mesh.root_stress and all(map(keeps_teeth, keys))))
    )


def is_light(key: str, mesh: MeshKeys, pinion_shaft: ShaftKeys) -> bool:
    """Whether a key leaves gears, shafts and grid as they are, and any value of its range can be.

    **Arguments:**

    - `key`: a real one.
    - `mesh`, `pinion_shaft`: tables of its scene.
    """
    if key == _TORQUE:
        return not (couples_on_pinion(pinion_shaft) or mesh.tip_contact)
    ends = "_N_m", "_Nm_rad"
    return key.startswith(("flank.", _ALIGNMENT)) or key.endswith(ends)


def shape_of(model: PairModel, grid: MeshGrid, base: MeshGrid) -> Shape:
    """The shape of a design: that of the scene itself, if it is about as long in single contact."""
    share, own = base.phases // _SHARE, grid.entry_phases
    near = abs(own - base.entry_phases) <= share
    # Where phases lie is a choice; each that is made is a program to compile.
    entry = base.entry_phases if near else min(max(share * round(own / share), 1), grid.phases - 1)
    return Shape(dataclasses.replace(grid, entry_phases=entry), jax.tree.structure(model))


def shape_at(design: BuiltScene, base: MeshGrid) -> Shape:
    """The shape of a design by itself.

    **Raises:**

    - `ValueError` if its gears are impossible.
    """
    return shape_of(design.model, design.grid, base)


def programs_of(
    study: Study,
    template: BuiltScene,
    keys: tuple[str, ...],
    grid: MeshGrid,
    *,
    batched: bool = False,
) -> list[Callable]:
    """Functions of many rows of values of the keys, and of which rows count: one for each device.

    **Arguments:**

    - `study`: says what is kept.
    - `template`: a design of the shape.
    - `keys`: whose values change.
    - `grid`: phases, lines and slices.
    - `batched`: whether rows are solved side by side, to compare.
    """
    keep, moved = study.asked.keep, Keys(template.scene, keys)
    influences = template.influences
    names = (*keep.numbers, DEFLECTION)

    def respond(values: Reals) -> tuple[Reals, tuple[Flags, tuple[Reals, ...]]]:
        own = moved.moved(values)
        model, law = model_of(own), law_of(own.mesh)
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        found = numbers_together(names, model, cycle, law, influences)
        kept = (*keep.arrays, *PLACES) if keep.arrays else ()
        arrays = tuple(array_of(name, model, cycle, law) for name in kept)
        return found, (cycle.converged, arrays)

    # Traced once, for what it returns and for the loop.
    @jax.jit
    def one(values: Reals) -> Found:
        if keep.gradients:
            found, (converged, arrays), slopes, _ = linearised(respond)(
                values, jnp.eye(len(keys)), None
            )
            return Found(found, converged, arrays, slopes[:, :-1])
        found, (converged, arrays) = respond(values)
        return Found(found, converged, arrays, None)

    def program(rows: Reals, counts: Flags) -> Found:
        if batched:
            return jax.vmap(one)(rows)
        nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(one, rows[0]))
        solved = lambda row: jax.lax.cond(row[1], one, lambda values: nothing, row[0])
        return jax.lax.map(solved, (rows, counts))

    devices = jax.local_devices()
    size = -(-study.chunk // len(devices))
    kinds = (Kind((size, len(keys)), np.dtype(float)), Kind((size,), np.dtype(bool)))
    structure = jax.tree.structure((0, 0))
    programs = []
    for device in devices:
        with jax.default_device(device):
            programs.append(compiled_program(program, structure, kinds, USUALLY))
    return programs


def called(programs: Sequence[Callable], rows: np.ndarray, size: int) -> Found:
    """Call the programs of all devices at once with rows of values, dealt out in turn.

    **Arguments:**

    - `programs`: from `programs_of`.
    - `rows`: of values, as many as a chunk has or fewer.
    - `size`: designs of a chunk.
    """
    count, most = len(programs), -(-size // len(programs))
    # A call is filled up, and one without any row is made too: rows that do not count cost nothing.
    filled = np.pad(rows, ((0, count * most - len(rows)), (0, 0)), mode="edge")
    counts = np.arange(len(filled)) < len(rows)
    # None is waited for before all have begun.
    found = [each(filled[at::count], counts[at::count]) for at, each in enumerate(programs)]

    def woven(*parts: Any) -> np.ndarray:
        whole = np.stack([np.asarray(part) for part in parts], axis=1)
        return whole.reshape(-1, *whole.shape[2:])[: len(rows)]

    return jax.tree.map(woven, *found)
