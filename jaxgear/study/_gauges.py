"""Strain gauges on condensed bodies: where they are, and what they read at rest and in motion."""

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence

import equinox as eqx
import numpy as np
import xarray as xr

from fem_prep import HeatedBody, StressRows, heat_stress
from jaxgear._checks import require
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._response._body_motion import BodyMotion, rotating_spectrum
from jaxgear._response._gauges import (
    GaugeInfluences,
    direction_rows,
    gauge_influences,
    gauge_readings,
)
from jaxgear._response._spectrum import Spectrum
from jaxgear._response._waves import DIRECTIONS, circle_around, fixed_spectrum, seen_passing
from jaxgear._system._body_modes import BodyBasis
from jaxgear._units import MPa, deg, mm
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._body_heat import free_strains
from jaxgear.scene._body_stress import stress_at
from jaxgear.scene._body_tables import TemperatureKeys
from jaxgear.scene._mesh_bodies import MeshBody
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import GaugeKeys, MeshKeys
from jaxgear.study._hybrid import radius_of, strain_of
from jaxgear.study._moving_body import MovingBody, angle_of
from jaxgear.study._probes import nodes_at, on_gear
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, dataset_of
from jaxgear.study._statics import Statics

# Strain in the unit of files.
MICRO = 1e-6


@dataclasses.dataclass(frozen=True)
class Gauge:
    """A strain gauge: strain along its direction, and the normal stress there.

    **Fields:**

    - `name`: in results.
    - `gear`: `pinion` or `wheel`.
    - `turns`: whether it turns with the body.
    - `angle`: of one that stands still, about Z from S [rad].
    - `places`: of the node, or of all nodes of the circle that passes; radius, angle and height of
        each, shape `[node, 3]` [m, rad, m].
    - `rows`: strain and stress of these per coordinate, shape `[node, 2, coordinate]` [1/m, Pa/m].
    - `rotation`: of rotation beside the coordinates, shape `[node, 2]` [s2, Pa s2].
    - `heat`: of heat beside the coordinates, per free strain of hub and rim, shape `[node, 2, 2]`
        [-, Pa].
    - `stress`: all components of the stress there.
    - `warm`: what heat adds to these beside the coordinates, shape `[node, 6, 2]` [Pa].
    - `warmth`: of one in motion, what it shows of heat beside seats and modes, shape `[node, 2]`
        [-, Pa].
    """

    name: str
    gear: str
    turns: bool
    angle: float
    places: np.ndarray
    rows: np.ndarray
    rotation: np.ndarray
    heat: np.ndarray
    stress: StressRows
    warm: np.ndarray
    warmth: np.ndarray | None = None

    def on(self, body: MovingBody, temperature: TemperatureKeys, *, grows: bool = True) -> "Gauge":
        """The gauge by what a body in motion is told by, in place of its condensed coordinates.

        What the modes leave out of rotation and heat is beside them, so that it shows all of both.

        **Arguments:**

        - `body`: in motion.
        - `temperature`: of the body.
        - `grows`: whether rotation loads it.
        """
        load = np.stack([body.built.body.centrifugal_load, *body.heat_load], axis=1)
        beside = self.rows @ body.left_out(load)
        strain = np.asarray(free_strains(temperature))
        return dataclasses.replace(
            self,
            rows=self.rows @ body.motions,
            rotation=(self.rotation + beside[..., 0]) * grows,
            warmth=(self.heat + beside[..., 1:]) @ strain if len(body.heat_load) else None,
        )

    def spectrum(self, motion: BodyMotion) -> Spectrum:
        """Strain and stress by orders of the gear's rotation, shape `[order, 2]` [-, Pa].

        Of a gauge on a body in motion.
        """
        if self.turns:
            found = rotating_spectrum(motion, self.rows[0])
        else:
            found = fixed_spectrum(motion, circle_around(self.places[:, 1], self.rows), self.angle)
        amplitude = found.amplitude.copy()
        still = motion.speed**2 * self.rotation
        still = still if self.warmth is None else still + self.warmth
        amplitude[found.order == 0.0] += still.mean(axis=0)
        return Spectrum(found.order, amplitude)

    def shown(self, readings: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """What it shows of the readings of all its nodes, of a body that has turned so far.

        **Arguments:**

        - `readings`: shape `[phase, node, 2]` [-, Pa].
        - `turn`: of the body's x from S about Z, shape `[phase]` [rad].

        **Returns:**

        Shape `[phase, 2]` [-, Pa].
        """
        if self.turns:
            return readings[:, 0]
        return seen_passing(self.places[:, 1], self.angle, readings, turn)


def gauges_of(
    asked: Sequence[GaugeKeys],
    condensed: Collection[str],
    gear: str,
    built: BuiltBody,
    heated: HeatedBody | None,
) -> tuple[Gauge, ...]:
    """The gauges of a scene on one of its condensed bodies, and what heat does to that.

    **Raises:**

    - `ValueError` if a gauge is where there is no node, or its gear is not condensed.
    """
    rows = on_gear("gauges", asked, condensed, gear, "stresses")
    return tuple(_gauge(row, each, built, heated) for row, each in rows)


def _gauge(row: str, asked: GaugeKeys, built: BuiltBody, heated: HeatedBody | None) -> Gauge:
    turns = asked.frame == "rotating"
    place = asked.radius_mm * mm, asked.angle_deg * deg, asked.height_mm * mm
    chosen = nodes_at(built.body, asked.gear, place, turns=turns, key=row)
    stress = stress_at(built, chosen)
    places = np.stack([radius_of(stress.places), angle_of(stress.places), stress.places[:, 2]], 1)
    material, along = built.plan.material, _directions(asked, places[:, 1])
    warm = np.zeros((len(chosen), 6, 2))
    if heated is not None:
        warm = np.moveaxis(heat_stress(heated, built.body, material, stress), 0, 2)
    rows, rotation, heat = (
        direction_rows(each, along, material.young, material.poisson)
        for each in (stress.rows, stress.rotation, warm)
    )
    where = f"{asked.gear} r {asked.radius_mm:.4g} mm {asked.direction} {asked.frame}"
    return Gauge(
        name=asked.name or where,
        gear=asked.gear,
        turns=turns,
        angle=place[1],
        places=places,
        rows=rows,
        rotation=rotation,
        heat=heat,
        stress=stress,
        warm=warm,
    )


def _directions(asked: GaugeKeys, angles: np.ndarray) -> np.ndarray:
    """Unit vectors of a gauge along x, y, z at nodes, shape `[node, 3]` [-]."""
    first, turn = DIRECTIONS.index(asked.direction), asked.turn_deg * deg
    local = np.zeros(3)
    local[first], local[(first + 1) % 3] = np.cos(turn), np.sin(turn)
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y = local[0] * cosine - local[1] * sine, local[0] * sine + local[1] * cosine
    return np.stack([x, y, np.full_like(x, local[2])], axis=1)


# --- At rest


def influences_of(
    mesh: MeshKeys,
    body: MeshBody,
    gauges: Sequence[Gauge],
    pair: GearPair,
    grid: MeshGrid,
    basis: BodyBasis | None = None,
) -> GaugeInfluences:
    """What all nodes of some gauges read of a body's teeth, seats, rotation and heat.

    Strain and stress of each node beside each other; in motion with the modes of a basis.
    """
    together = lambda name: np.concatenate([getattr(each, name) for each in gauges])
    rows, rotation = together("rows"), together("rotation")
    heated = body.heated
    warm = together("heat").reshape(-1, 2)
    return gauge_influences(
        body.built.body,
        rows.reshape(-1, rows.shape[2]),
        rotation.ravel(),
        pair,
        GEARS.index(body.built.plan.gear),
        grid,
        components=body.flexible.components,
        points=mesh.root_points,
        axial=mesh.connection,
        heat=None if heated is None else (warm, heated.load),
        basis=basis,
    )


def gauges_dataset(
    mesh: MeshKeys, asked: Sequence[GaugeKeys], bodies: Mapping[str, MeshBody], statics: Statics
) -> xr.Dataset:
    """What the gauges of a scene read while each gear turns once, tooth by tooth at rest."""
    entries: dict[str, Entry] = {}
    require(
        len(bodies) > 0,
        "gauges: they are on condensed bodies, of which this scene has none. Write "
        '[wheel.body] kind = "condensed", or leave them out.',
    )
    for gear, body in bodies.items():
        gauges = gauges_of(asked, bodies, gear, body.built, body.heated)
        if gauges:
            entries |= _over_revolution(gear, gauges, _readings(mesh, body, gauges, statics))
    return dataset_of(entries)


def _readings(
    mesh: MeshKeys, body: MeshBody, gauges: Sequence[Gauge], statics: Statics
) -> tuple[np.ndarray, np.ndarray]:
    """Of each gauge over a revolution, `[gauge, phase, 2]` [-, Pa], and the body's turn [rad]."""
    model = statics.model
    influences = influences_of(mesh, body, gauges, model.pair, statics.grid)
    strain = strain_of(model, influences.index)
    readings, turn = eqx.filter_jit(gauge_readings)(
        influences, model.pair, statics.cycle, model.speed, strain
    )
    of_nodes = np.asarray(readings).reshape(len(turn), -1, 2)
    ends = np.cumsum([len(each.places) for each in gauges])[:-1]
    parts = zip(gauges, np.split(of_nodes, ends, axis=1), strict=True)
    return np.stack([each.shown(own, np.asarray(turn)) for each, own in parts]), np.asarray(turn)


def _over_revolution(
    gear: str, gauges: Sequence[Gauge], found: tuple[np.ndarray, np.ndarray]
) -> Iterator[tuple[str, Entry]]:
    readings, turn = found
    over, gauge = f"{gear}_turn", f"{gear}_gauge"
    turned = np.abs(np.unwrap(turn) - turn[0]) / deg
    dims, words = (gauge, over), "along a gauge, static"
    yield over, Entry((over,), turned, "deg", f"angle by which the {gear} has turned")
    yield from gauge_places(gear, gauges)
    strain = readings[..., 0] / MICRO
    yield f"{gauge}_strain_um_m", Entry(dims, strain, "um/m", f"strain {words}")
    stress = readings[..., 1] / MPa
    yield f"{gauge}_stress_MPa", Entry(dims, stress, "MPa", f"normal stress {words}")


def gauge_places(gear: str, gauges: Sequence[Gauge]) -> Iterator[tuple[str, Entry]]:
    """Names of gauges, whether they turn, and where they are, as entries of a dataset."""
    gauge = f"{gear}_gauge"
    yield gauge, Entry((gauge,), [each.name for each in gauges], "1", "gauge")
    turns = [each.turns for each in gauges]
    words = "whether the gauge turns with the body"
    yield f"{gauge}_turns", Entry((gauge,), turns, "1", words)
    for number, (name, unit, size) in enumerate(
        (("radius_mm", "mm", mm), ("angle_deg", "deg", deg), ("height_mm", "mm", mm))
    ):
        at = [
            each.angle if number == 1 and not each.turns else each.places[0, number]
            for each in gauges
        ]
        place = Entry((gauge,), np.array(at) / size, unit, f"{name.split('_')[0]} of the gauge")
        yield f"{gauge}_{name}", place


def gauges_summary(dataset: xr.Dataset) -> list[Summary]:
    """Mean, amplitude and extremes of each gauge over a revolution, from their dataset."""
    found = []
    for gear in GEARS:
        gauge = f"{gear}_gauge"
        for row in range(dataset.sizes.get(gauge, 0)):
            own = dataset.isel({gauge: row})
            strain, stress = (own[f"{gauge}_{name}"] for name in ("strain_um_m", "stress_MPa"))
            found.append(
                {
                    "name": str(own[gauge].item()),
                    "gear": gear,
                    "frame": "rotating" if own[f"{gauge}_turns"].item() else "fixed",
                    **{
                        name: own[f"{gauge}_{name}"].item()
                        for name in ("radius_mm", "angle_deg", "height_mm")
                    },
                    "strain_mean_um_m": float(strain.mean()),
                    "strain_amplitude_um_m": float(0.5 * (strain.max() - strain.min())),
                    "stress_largest_MPa": float(stress.max()),
                    "stress_least_MPa": float(stress.min()),
                    "stress_amplitude_MPa": float(0.5 * (stress.max() - stress.min())),
                }
            )
    return found


# --- In motion


def moving_gauges_dataset(
    gauges: Mapping[str, Sequence[Gauge]], motions: Mapping[str, BodyMotion]
) -> xr.Dataset:
    """Spectra of the gauges of each gear in some motion, by orders of its rotation."""
    entries: dict[str, Entry] = {}
    teeth = {}
    for gear, own in gauges.items():
        if own:
            entries |= _by_orders(gear, own, motions[gear])
            teeth[f"teeth_{gear}"] = motions[gear].teeth
    return dataset_of(entries).assign_attrs(teeth)


def _by_orders(
    gear: str, gauges: Sequence[Gauge], motion: BodyMotion
) -> Iterator[tuple[str, Entry]]:
    spectra = [each.spectrum(motion) for each in gauges]
    orders = np.unique(np.concatenate([each.order for each in spectra]))
    size = np.zeros((len(gauges), len(orders), 2))
    for row, each in zip(size, spectra, strict=True):
        row[np.searchsorted(orders, each.order)] = each.size
    over, gauge = f"{gear}_order", f"{gear}_gauge"
    dims, words = (gauge, over), "along a gauge at the highest peak; order 0: the mean"
    yield over, Entry((over,), orders, "1", f"order of the {gear}'s rotation")
    yield from gauge_places(gear, gauges)
    strain, stress = size[..., 0] / MICRO, size[..., 1] / MPa
    yield f"{gauge}_strain_um_m", Entry(dims, strain, "um/m", f"amplitude of the strain {words}")
    yield (
        f"{gauge}_stress_MPa",
        Entry(dims, stress, "MPa", f"amplitude of the normal stress {words}"),
    )
