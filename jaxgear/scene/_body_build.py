"""Condensed bodies from their plans, through the cache."""

import contextlib
import dataclasses
import math
import os
import time
import warnings
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from fem_prep import (
    BodyError,
    CacheWarning,
    FixedInterface,
    FullBody,
    Grid,
    ReducedBody,
    Rotation,
    Seat,
    body_grid,
    cached,
    check_grid,
    condense,
    described_modes,
    exact_properties,
    file_digest,
    files_of,
    fixed_interface,
    full_body,
    health_report,
    key_of,
    largest_rotation,
    reported_mode_count,
    solid_of,
)
from jaxgear._process import peak_memory
from jaxgear._units import mm
from jaxgear.scene._bodies import BodyPlan, Drawn, Matrices, OwnGrid
from jaxgear.scene._body_view import BodyView, keep_view, read_view
from jaxgear.scene._body_words import in_keys

# Full matrices of the condensed coordinates that are there at one time.
_MATRICES = 8
# Motions of the whole body with the rim's columns of one sector: themselves, and what they are on
# the way to their waves around. Of a body in one piece there is no such way.
_COPIES = 4

# What a container may take, by both generations of such limits; "max" if there is none.
_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)

# How far the rim of a body may be off the teeth's: more than their rounding, less than a tooth.
_RIM_OFF = 5e-3


@dataclasses.dataclass(frozen=True)
class BuiltBody:
    """A condensed body and how it came about.

    **Fields:**

    - `plan`: what it was made from.
    - `body`: the condensed body; its facts hold the health report.
    - `view`: what pictures show; None without a grid.
    - `key`: its name in the cache.
    - `from_cache`: whether it was there.
    - `seconds`: that it took to build or to read [s].
    - `build_seconds`, `peak_memory`: by step [s], and the most memory that the process has had
        [MB]; None of a body from the cache: what depends on the day is not part of a body.
    - `warnings`: what the cache could not do.
    """

    plan: BodyPlan
    body: ReducedBody
    view: BodyView | None
    key: str
    from_cache: bool
    seconds: float
    build_seconds: Mapping[str, float] | None
    peak_memory: float | None
    warnings: tuple[str, ...] = ()

    def held(self, tell: Callable[[str], None] = lambda step: None) -> FixedInterface:
        """With its rim and its seats held, its stiffness factorised: once, and steps are told."""
        known, steps = vars(self), Steps(tell)
        if "_held" not in known:
            known["_held"] = fixed_interface(full_of(self.plan, steps), progress=steps)
        found: FixedInterface = known["_held"]
        return found

    @property
    def health(self) -> Mapping[str, Any]:
        """What the body is and how far it is from the full one, a unit in every name."""
        return cast(Mapping[str, Any], self.body.facts["health"])


class Steps:
    """Tells what begins, and remembers how long each step took.

    **Fields:**

    - `seconds`: by step [s].
    """

    def __init__(self, tell: Callable[[str], None]):
        self.seconds: dict[str, float] = {}
        self._tell = tell

    @contextlib.contextmanager
    def __call__(self, step: str) -> Generator[None]:
        """A context that lasts as long as the step."""
        self._tell(step)
        start = time.perf_counter()
        yield
        self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - start


def built_body(plan: BodyPlan, tell: Callable[[str], None]) -> BuiltBody:
    """The body of a plan, from the cache if it is there.

    **Raises:**

    - `ValueError` if the body cannot be; the message says what to do.
    """
    start = time.perf_counter()
    with in_keys(plan.gear):
        key = key_of(_inputs(plan))
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", CacheWarning)
            steps = Steps(tell)
            body, found = cached(key, lambda: _build(plan, key, steps))
        body = dataclasses.replace(body, name=plan.name)
        view = read_view(key, len(body.nodes)) if len(body.nodes) else None
        if view is None and len(body.nodes):
            view = _view(body, full_of(plan, Steps(tell)), Steps(tell))
            keep_view(key, view)
    warned = tuple(str(each.message) for each in said)
    cost = (None, None) if found else (steps.seconds, peak_memory())
    return BuiltBody(plan, body, view, key, found, time.perf_counter() - start, *cost, warned)


def _inputs(plan: BodyPlan) -> dict[str, object]:
    """What a plan says, and the content of its files in place of their names."""
    source = plan.source
    fields: dict[str, object] = {
        each.name: getattr(plan, each.name)
        for each in dataclasses.fields(plan)
        if each.name != "name"
    }
    if isinstance(source, Drawn):
        return fields
    kept = {each.name: getattr(source, each.name) for each in dataclasses.fields(source)}
    for name, value in kept.items():
        paths = value if isinstance(value, tuple) else (value,)
        if any(isinstance(path, Path) for path in paths):
            kept[name] = [_digest(path) for path in paths]
    return fields | {"source": {type(source).__name__: kept}}


def _digest(path: Path) -> list[str]:
    """Content of a file and of those that are read with it."""
    beside = [path.with_suffix(end) for end in (".mas", ".dof") if path.suffix == ".sti"]
    try:
        found = [file_digest(each) for each in (path, *filter(Path.is_file, beside))]
        return found + [file_digest(each) for each in files_of(path)[1:]]
    except OSError as error:
        raise BodyError(
            f"The file {path} cannot be read: {error.strerror}. A relative path is relative to the "
            "folder of the scene file."
        ) from error


# --- Building


def _build(plan: BodyPlan, key: str, steps: Steps) -> ReducedBody:
    """A body made anew, with its health among its facts; its view goes into the cache."""
    full = held = exact = None
    if isinstance(plan.source, Matrices):
        body = _imported(plan, plan.source, steps)
    else:
        full = full_of(plan, steps)
        rotation = largest_rotation(full)
        _check_memory(full, rotation)
        held = fixed_interface(full, rotation=rotation, progress=steps)
        body = condense(
            full,
            method=plan.method,
            modes=plan.modes,
            rotating=plan.rotating,
            held=held,
            progress=steps,
        )
    modes = described_modes(body, held, count=reported_mode_count(body), progress=steps)
    if isinstance(plan.source, Drawn):
        exact = solid_of(exact_properties(plan.source.body), plan.material.density)
    health = health_report(
        full,
        held,
        body,
        exact=exact,
        modes=modes,
        root_thickness=plan.root_thickness,
        torque_seat=plan.torque_seat or None,
        couplings=plan.compares_seats,
        progress=steps,
    )
    if full is not None:
        keep_view(key, BodyView(full.grid.sets, modes.shapes.astype(np.float32)))
    facts = {
        "gear": plan.gear,
        "source": type(plan.source).__name__,
        "teeth_count": plan.teeth_count,
        "torque_seat": plan.torque_seat,
        "health": health,
    }
    return dataclasses.replace(body, facts={**body.facts, **facts})


def _check_memory(full: FullBody, rotation: Rotation) -> None:
    """Refuse a rim whose matrices and columns the machine cannot hold."""
    rim, sectors = 3 * len(full.rim), rotation.sectors
    coordinates = rim + 6 * len(full.seats)
    columns = (1 if sectors == 1 else _COPIES) * 3 * full.points * (rim // sectors)
    needed, there = 8 * (_MATRICES * coordinates**2 + columns), _memory()
    if needed < there:
        return
    raise BodyError(
        "The rim has {rim:,} nodes: condensing its {coordinates:,} coordinates, in a body of "
        "{sectors} equal sectors, takes some {needed:.3g} GB, and {there:.3g} are free. Use fewer "
        "elements around or across the rim (body.fineness), or a body that repeats more often.",
        {
            "rim": len(full.rim),
            "coordinates": coordinates,
            "sectors": sectors,
            "needed": needed / 1e9,
            "there": there / 1e9,
        },
    )


def _memory() -> float:
    """Memory to be had [byte]: what is free, or all if that is not known; infinite if nothing is.

    A container may have less than its machine.
    """
    found = [math.inf]
    with contextlib.suppress(AttributeError, OSError, ValueError):
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with contextlib.suppress(OSError):
        # What of the memory caches of files hold is free too; `SC_AVPHYS_PAGES` leaves that out.
        lines = Path("/proc/meminfo").read_text("utf-8").splitlines()
        found += [1024 * float(each.split()[1]) for each in lines if "MemAvailable" in each]
    for limit in _LIMITS:
        with contextlib.suppress(OSError, ValueError):
            found.append(float(limit.read_text("utf-8")))
    return min(found)


def _view(body: ReducedBody, full: FullBody, steps: Steps) -> BodyView:
    """What pictures show of a body, made again."""
    held = fixed_interface(full, progress=steps)
    modes = described_modes(body, held, count=reported_mode_count(body), progress=steps)
    return BodyView(full.grid.sets, modes.shapes.astype(np.float32))


def _imported(plan: BodyPlan, source: Matrices, steps: Steps) -> ReducedBody:
    from fem_prep import import_superelement

    body = import_superelement(
        source.paths,
        source.nodes,
        units=source.units,
        name=plan.name,
        faces=source.faces,
        modes=plan.modes,
        mid_face=source.mid_face,
        mass=source.mass,
        progress=steps,
    )
    _check_rim(plan, body.rim_nodes)
    teeth = body.facts.get("teeth_count", plan.teeth_count)
    if teeth != plan.teeth_count:
        raise BodyError(
            f"The matrices are those of a gear of {teeth} teeth, and this one has "
            f"{plan.teeth_count}. Condense the body of this gear."
        )
    return body


def _check_rim(plan: BodyPlan, nodes: np.ndarray) -> None:
    """Refuse a rim that is not the one under the teeth: of another radius or width."""
    found = {
        "diameter": 2.0 * float(np.median(np.hypot(nodes[:, 0], nodes[:, 1]))),
        "width": float(np.ptp(nodes[:, 2])),
    }
    wanted = {"diameter": 2.0 * plan.root_radius, "width": plan.face_width}
    keys = {"diameter": "the root circle of its teeth", "width": f"`{plan.gear}.face_width_mm`"}
    for name, size in wanted.items():
        if abs(found[name] - size) > _RIM_OFF * size:
            raise BodyError(
                f"The rim must have the {name} of {keys[name]}, {size / mm:.6g} mm, but has "
                f"{found[name] / mm:.6g} mm. Is it the body of another gear, or its rim set that "
                "of another surface?"
            )


def full_of(plan: BodyPlan, steps: Steps) -> FullBody:
    """A body in all its unknowns."""
    with steps("grid"):
        grid = _grid(plan)
        seats = [f"seat:{seat.label}" for seat in plan.seats]
        check_grid(grid, needs=("rim", *seats), radius=plan.root_radius)
        _check_rim(plan, grid.nodes[grid.sets["rim"]])
    held = [
        Seat(seat.name, grid.sets[label], np.array([0.0, 0.0, seat.at]), seat.averaging)
        for seat, label in zip(plan.seats, seats, strict=True)
    ]
    return full_body(plan.name, grid, plan.material, held, teeth=plan.teeth, progress=steps)


def _grid(plan: BodyPlan) -> Grid:
    source = plan.source
    if isinstance(source, Drawn):
        return body_grid(source.body, source.fineness)
    assert isinstance(source, OwnGrid)
    from fem_prep import read_grid

    seats = {seat.label: seat.label for seat in plan.seats}
    return read_grid(source.path, rim=source.rim, seats=seats, length_unit=source.length_unit)
