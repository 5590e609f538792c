"""The condensed bodies of a scene, built and put in mesh."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import Any, cast

import jax.numpy as jnp
import numpy as np

from fem_prep import HeatedBody
from jaxgear._checks import InputError, require
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_family import BodyFamily, body_family, family_parameters
from jaxgear._system._body_in_mesh import BodyInMesh
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._body_tables import body_in_mesh, repeats_under
from jaxgear._system._excited_shapes import excited_shapes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._mode_combinations import lowest_modes
from jaxgear._system._rim_checks import require_short_elements
from jaxgear.scene._bodies import BodyPlan, Drawn, body_plan
from jaxgear.scene._body_build import BuiltBody, built_body
from jaxgear.scene._body_tables import WebKeys
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._build import couples_on_pinion, pair_grid, pair_of
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._heated_bodies import heat_of
from jaxgear.scene._plain_ring import beyond_plain_ring
from jaxgear.scene._rim_ribs import rim_ribs
from jaxgear.scene._root_correction import root_correction
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.scene._tables import MeshKeys, ModelKeys, SweepKeys


@dataclasses.dataclass(frozen=True)
class MeshBody:
    """A condensed body, and what of it the mesh sees.

    **Fields:**

    - `built`: the body and how it came about.
    - `flexible`: its tables, for the slices and contact lines of the scene.
    - `basis`: motions on which it vibrates, or `None`: it is for statics.
    - `natural`: all natural modes that were found, of which these are some, or combinations.
    - `in_mesh`: the body, to be given others of them.
    - `follows`: key of a measure of its web that is to be varied, or `None`.
    - `family`: bodies over that measure, in the unit of its key; their statics is the body's.
    - `heated`: what heat does to it, or `None`: the scene gives no temperatures.
    - `made_of`: natural modes, as they repeat under its teeth, of which these motions are
        combinations, or `None`: they are natural modes.
    - `into`: the motions by these, `[mode, motion]`, or `None` [-].
    """

    built: BuiltBody
    flexible: FlexibleBody
    basis: BodyBasis | None
    natural: BodyBasis | None = None
    in_mesh: BodyInMesh | None = None
    follows: str | None = None
    family: BodyFamily | None = None
    heated: HeatedBody | None = None
    made_of: BodyBasis | None = None
    into: np.ndarray | None = None

    @functools.cached_property
    def of_modes(self) -> FlexibleBody:
        """Its tables on the natural modes of which its motions are combinations."""
        if self.made_of is None:
            return self.flexible
        assert self.in_mesh is not None
        return self.in_mesh.moving(self.made_of)

    @property
    def more_modes(self) -> tuple[FlexibleBody, np.ndarray] | None:
        """Its tables on more natural modes than it has motions, and the latter by these.

        Those of which its motions are combinations, or of natural modes twice as many; `None`:
        no more were found.
        """
        if self.into is not None:
            return self.of_modes, self.into
        basis, natural, in_mesh = self.basis, self.natural, self.in_mesh
        if basis is None or natural is None or in_mesh is None:
            return None
        own = len(basis.square)
        more = lowest_modes(natural, _RICHER * own)
        if len(more.square) == own:
            return None
        sectors = cast(int, in_mesh.condensed.facts["sectors"])
        more, _ = more.under_teeth(self.built.plan.teeth_count, sectors)
        return in_mesh.moving(more), np.eye(len(more.square), own)


# So many times more natural modes judge those that are kept.
_RICHER = 2

# A condensed body that is not in mesh yet, and motions on which it vibrates; none for statics.
_Made = tuple[BuiltBody, BodyBasis | None]


def with_bodies(
    scene: Scene, tell: Callable[[str], None] = lambda step: None, *, moving: bool = False
) -> Scene:
    """A scene with the condensed bodies that it names, from the cache where they are known.

    **Raises:**

    - `ValueError` if a body cannot be, or not carry its teeth.
    """
    pair = pair_of(scene)
    torque = jnp.asarray(scene.pair.torque_pinion_Nm + couples_on_pinion(scene.pinion.shaft))
    # All plans before any long work: a mistake in the second costs no wait.
    plans = [body_plan(scene, gear) for gear in scene.condensed]
    for plan in plans:
        if isinstance(plan.source, Drawn):
            with in_keys(plan.gear):
                pitches = scene.gear(plan.gear).teeth / plan.source.fineness.sectors
                require_short_elements(plan.gear, pitches)
    if moving:
        _require_able_to_move(scene.mesh, scene.model, scene.gears, plans)
    # Modes do not follow: what is to vibrate stays as it is.
    measures: dict[str, str | None] = {}
    if not moving:
        webs = {plan.gear: scene.gear(plan.gear).body.web for plan in plans}
        measures = {p.gear: _varied_measure(scene.optimise, webs[p.gear], p) for p in plans}
    # Residual shapes are of all modes.
    modes = (0 if scene.model.shapes == "excited" else scene.shape_count) if moving else None
    made = [_made(plan, tell, modes) for plan in plans]
    needed = _repeats(scene.gears, made)
    if scene.mesh.periods % needed:
        _require_free_cycle(scene.mesh, needed)
        scene = scene.replace({"mesh.periods": needed})
    if moving:
        scene = _unsaid(scene, _for_long_cycles(scene.mesh, scene.sweep))
    if needed > 1:
        kept = _where_teeth_differ(scene.model, scene.plain.pair.helix_angle_deg)
        scene = _unsaid(scene, kept)
    grid = pair_grid(scene.mesh, pair, torque, scene.map.torques_Nm, condensed=True)
    put = lambda each, told: _in_mesh(each, scene, pair, grid, told)
    bodies = {each[0].plan.gear: put(each, tell) for each in made}
    for gear, key in measures.items():
        if key is not None:
            plan_at = lambda value, key=key, gear=gear: body_plan(scene.replace({key: value}), gear)
            bounds, value = scene.optimise.bounds[key], scene.value(key)
            bodies[gear] = _with_family(bodies[gear], key, value, bounds, plan_at, put, tell)
    return dataclasses.replace(scene, bodies=MappingProxyType(bodies))


def _require_able_to_move(
    mesh: MeshKeys, model: ModelKeys, gears: Mapping[str, GearKeys], plans: Sequence[BodyPlan]
) -> None:
    """Refuse before any long work what condensed bodies cannot do in motion."""
    require(
        mesh.tooth == "sliced",
        'mesh.tooth = "{tooth}": a condensed body carries such teeth in statics only, for the ring '
        'under them has no modes. Write mesh.tooth = "sliced" for what is in motion, or make the '
        "body rigid.",
        tooth=mesh.tooth,
    )
    for gear in GEARS if plans else ():
        require(
            not gears[gear].thickness_allowance_um,
            "{gear}.thickness_allowance_um: back flanks are for rigid bodies and beams in motion; "
            "teeth on a condensed body press on its rim by their drive flanks alone. Leave it out, "
            "or make condensed bodies rigid.",
            gear=gear,
        )
    for plan in plans:
        require(
            plan.rotating or not model.gyroscopic,
            "model.gyroscopic: gyroscopic forces of a condensed body need its terms of rotation. "
            "Write {gear}.body.rotating_terms = true, or leave model.gyroscopic out.",
            gear=plan.gear,
        )


def _varied_measure(asked: OptimiseKeys, web: WebKeys, plan: BodyPlan) -> str | None:
    """The measure of a gear's web that the scene varies, if it is one and has bounds."""
    table = f"{plan.gear}.body.web."
    measures = {f"{table}{name}": value for name, value in web.values.items() if value is not None}
    keys = [key for key in (asked.vary or ()) if key in measures]
    if len(keys) != 1 or not isinstance(plan.source, Drawn):
        return None
    key = keys[0]
    bounds = asked.bounds.get(key)
    require(
        bounds is not None and bounds[0] < bounds[1],
        "optimise.vary names {key}: bodies are condensed from one bound to the other, and "
        "interpolated. Give both, rising, in the table [optimise.bounds], such as\n"
        '"{key}" = [{low:.6g}, {high:.6g}]',
        key=key,
        low=0.8 * measures[key],
        high=1.2 * measures[key],
    )
    return key


# Bodies of a family: of a web between half and twice its thickness, off by less than 0.1 %.
_MEMBERS = 5


def _with_family(
    own: MeshBody,
    key: str,
    measure: float,
    bounds: Sequence[float],
    plan_at: Callable[[float], BodyPlan],
    put: Callable[[_Made, Callable[[str], None]], MeshBody],
    tell: Callable[[str], None],
) -> MeshBody:
    """A body with others of its shape, from one bound of a measure to the other."""
    low, high = bounds
    reciprocal = low > 0.0
    at, checks = family_parameters(low, high, _MEMBERS, reciprocal=reciprocal)
    bodies, nodes = {}, {}
    for number, value in enumerate(map(float, (*at, *checks)), start=1):
        where = f"{key} = {value:.6g}, {number} of {_MEMBERS + len(checks)}"
        # Of rim and seats, and of rotation, statics is exact without any shapes of the inside.
        plan = dataclasses.replace(
            plan_at(value), method="guyan", modes=0, rotating=False, compares_seats=False
        )
        along = lambda step, where=where: tell(f"{step}: {where}")
        found = put(_made(plan, along, None), along)
        bodies[value] = found.flexible
        nodes[value] = int(found.built.health["nodes"])
    probes = [(value, bodies[value]) for value in map(float, checks)]
    try:
        family = body_family(
            at,
            [bodies[float(value)] for value in at],
            checks=[*probes, (measure, own.flexible)],
            reciprocal=reciprocal,
        )
    except ValueError as error:
        raise InputError(f"{key}: {error}{_grids_that_differ(nodes)}") from error
    return dataclasses.replace(own, follows=key, family=family)


def _grids_that_differ(nodes: dict[float, int]) -> str:
    """What to say of a family whose bodies have not the same elements; nothing if they have."""
    if len(set(nodes.values())) == 1:
        return ""
    ranges = [list(each) for _, each in groupby(sorted(nodes), key=nodes.__getitem__)]
    told = ", ".join(
        f"{nodes[each[0]]} nodes from {each[0]:.4g} to {each[-1]:.4g}" for each in ranges
    )
    return (
        f" Here the number of elements changes on the way: {told}. Choose bounds between which it "
        "stays, or set body.fineness, first of all web_layers, so that it does."
    )


def _made(plan: BodyPlan, tell: Callable[[str], None], modes: int | None) -> _Made:
    """A body from the cache or built anew, with so many modes if it is to vibrate."""
    built = built_body(plan, lambda step: tell(f"{plan.gear}: {step}"))
    if modes is None:
        return built, None
    tell(f"{plan.gear}: modes with its seats held")
    with in_keys(plan.gear):
        return built, body_basis(built.body, modes)


def _repeats(gears: Mapping[str, GearKeys], made: Sequence[_Made]) -> int:
    """Mesh periods after which all that vibrates is itself again under its teeth."""
    needed = 1
    for built, basis in made:
        if basis is not None:
            teeth, sectors = gears[built.plan.gear].teeth, built.body.facts["sectors"]
            assert isinstance(sectors, int)
            needed = math.lcm(needed, basis.repeats(teeth, sectors))
    return needed


def _require_free_cycle(mesh: MeshKeys, needed: int) -> None:
    """Refuse a cycle that the scene names and that is no multiple of these mesh periods.

    In a shorter one holes would pass the mesh in another order than they do, and modes jump where
    it closes.
    """
    require(
        "periods" not in mesh.given,
        "mesh.periods = {got}: in motion the condensed bodies of this scene repeat under "
        "their teeth after {needed} mesh periods, so that a response over {got} would not "
        "close. Write mesh.periods = {needed}, or leave it out.",
        got=mesh.periods,
        needed=needed,
    )


def _unsaid(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """A scene with other values of keys that nobody gave: time steps are no wish to sweep."""
    return dataclasses.replace(scene.replace(changes), given=scene.given)


def _where_teeth_differ(model: ModelKeys, helix: float) -> dict[str, Any]:
    """Shapes of bodies on which no two teeth stand alike, by path, unless the scene says.

    Where holes pass by, static answers of what shapes leave out are many. Residual shapes hold few
    of them, and natural modes leave less to them than excited shapes do: of `power-holes` RMS of TE
    is within 0.5 % of far richer models in place of 9 %. Spur teeth load few waves, of which
    excited shapes have enough.
    """
    if not helix or "shapes" in model.given:
        return {}
    count = {} if "coordinates" in model.given else {"model.coordinates": 800}
    return {"model.shapes": "natural", **count}


# Cycles of more mesh periods are long. Of 68, 20 harmonics take twice as long as 10,
# which find the largest force within 0.2 %.
_LONG, _OVER_LONG = 20, {"sweep.steps": 64, "sweep.harmonics": 10}


def _for_long_cycles(mesh: MeshKeys, sweep: SweepKeys) -> dict[str, int]:
    """Time steps and harmonics over a long cycle, by path, unless the scene says."""
    says = {"steps", "harmonics"} & set(sweep.given) or sweep.method in ("newmark", "shooting")
    return {} if says or mesh.periods <= _LONG else _OVER_LONG


def _in_mesh(
    made: _Made, scene: Scene, pair: GearPair, grid: MeshGrid, tell: Callable[[str], None]
) -> MeshBody:
    mesh, plain = scene.mesh, scene.plain
    built, natural = made
    plan, body = built.plan, built.body
    tell(f"{plan.gear}: teeth on the rim")
    index, local, give, ribs = GEARS.index(plan.gear), None, None, None
    heated = heat_of(built, plain.gear(plan.gear).body.temperature, tell)
    on_rim: Any = {"points": mesh.root_points, "axial": mesh.connection}
    with in_keys(plan.gear):
        if mesh.tooth == "elements":
            give = beyond_plain_ring(plain, plan, tell)
        elif mesh.root_correction:
            found = root_correction(body, plan.material, pair, index, grid, **on_rim)
            local = None if found is None else found.kept
        law = (mesh.tooth, mesh.stiffness, mesh.face_coupling)
        if law == ("sliced", "weber-banaschek", "coupled"):
            ribs = rim_ribs(plain, plan, pair, grid, tell, **on_rim)
        more: Any = {"local": local, "give": give, "ribs": ribs}
        seats: Any = {"gear_seat": plan.torque_seat or None, "load_seats": plan.load_seats}
        more |= {"motion": mesh.root_motion, "heat": None if heated is None else heated.load}
        repeats = repeats_under(body, plan.teeth_count, natural)
        in_mesh = body_in_mesh(body, pair, index, grid, repeats, **more, **seats, **on_rim)
    at_rest = MeshBody(built, in_mesh.still, None, natural, in_mesh, heated=heated)
    return at_rest if natural is None else _on_shapes(at_rest, scene, pair, grid, tell)


def with_shapes_of(scene: Scene, body: MeshBody) -> MeshBody:
    """A body that vibrates on the shapes that a scene asks for.

    **Arguments:**

    - `scene`: with the slices for which the body was put in mesh.
    - `body`: with all the natural modes that this takes.

    **Returns:**

    The body as `with_bodies` would have put it in mesh.
    """
    pair = pair_of(scene)
    torque = jnp.asarray(scene.pair.torque_pinion_Nm + couples_on_pinion(scene.pinion.shaft))
    grid = pair_grid(scene.mesh, pair, torque, scene.map.torques_Nm, condensed=True)
    return _on_shapes(body, scene, pair, grid, lambda step: None)


def _on_shapes(
    body: MeshBody, scene: Scene, pair: GearPair, grid: MeshGrid, tell: Callable[[str], None]
) -> MeshBody:
    """A body that vibrates on some of its natural modes, or on shapes that the mesh excites."""
    natural, in_mesh = body.natural, body.in_mesh
    count = scene.shape_count
    assert natural is not None
    assert in_mesh is not None
    gear, teeth = body.built.plan.gear, body.built.plan.teeth_count
    sectors = in_mesh.condensed.facts["sectors"]
    assert isinstance(sectors, int)
    if scene.model.shapes == "excited":
        tell(f"{gear}: shapes that the mesh excites")
        basis, _ = natural.under_teeth(teeth, sectors)
        shapes = excited_shapes(basis, in_mesh, pair, GEARS.index(gear), grid, count)
        if shapes is not None:
            return dataclasses.replace(body, **shapes.of_body(in_mesh, basis)._asdict())
    basis = lowest_modes(natural, count)
    flexible = in_mesh.moving(basis.under_teeth(teeth, sectors)[0])
    bare: Any = dict.fromkeys(("made_of", "into"))
    return dataclasses.replace(body, flexible=flexible, basis=basis, **bare)
