"""What unbalance does to a scene over the speeds of its sweep: the shafts' own orders.

Each shaft's unbalance shakes the whole pair at that shaft's rotation. Pinion and wheel turn at
different speeds, so that their amplitudes stay apart.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jaxgear._dynamics._system import PairDynamics
from jaxgear._response._unbalance import (
    Unbalance,
    UnbalanceResponse,
    unbalance_critical_speeds,
    unbalance_response,
)
from jaxgear.scene._unbalance import unbalances_of
from jaxgear.study._built import BuiltScene
from jaxgear.study._dynamics import speeds_of
from jaxgear.study._ranks import Doubtful
from jaxgear.study._result import Summary
from jaxgear.study._results import Entries, Entry, dataset_of, over
from jaxgear.study._running import timed
from jaxgear.study._statics_summary import bearings_of


class Shaken(NamedTuple):
    """What the unbalance of a scene does.

    **Fields:**

    - `dataset`: amplitudes over gear and speed, critical speeds.
    - `summary`: the largest of them.
    - `notes`: where they do not hold.
    """

    dataset: xr.Dataset
    summary: Summary
    notes: list[str]


def shaken(built: BuiltScene, pair: PairDynamics) -> Shaken:
    """Amplitudes by the unbalance of each shaft over the speeds of a scene's sweep.

    Critical speeds between these are among them.
    """
    asked, given = speeds_of(built.scene.sweep), unbalances_of(built.scene, built.model)
    critical = {gear: unbalance_critical_speeds(pair, each) for gear, each in given.items()}
    # No resonance is stepped over.
    met = np.concatenate(list(critical.values()))
    speeds = np.union1d(asked, met[(met > asked[0]) & (met < asked[-1])])
    found = {
        gear: jax.tree.map(np.asarray, timed(_over_speeds, pair, each, jnp.asarray(speeds)))
        for gear, each in given.items()
    }
    names = [f"{gear} {index}" for gear, index in bearings_of(built.model)]
    entries = {
        **over("gear", gear=(list(found), "gear whose unbalance it is")),
        **over("bearing", bearing=(names, "gear and number of the bearing")),
        **over("axis", axis=(list("STZ"), "direction of a load")),
        "speed": Entry(("speed",), speeds, "rad/s", "speed of the pinion"),
        **_amplitudes(list(found.values())),
        **_critical(critical),
    }
    dataset = dataset_of(entries).assign_attrs(
        teeth_pinion=built.model.pair.pinion.teeth,
        teeth_wheel=built.model.pair.wheel.teeth,
        static_mesh_force_N=float(pair.system.force),
    )
    return Shaken(dataset, _summary(dataset), list(_notes(dataset)))


def _over_speeds(
    pair: PairDynamics, unbalances: tuple[Unbalance, ...], speeds: Array
) -> UnbalanceResponse:
    """Responses to the unbalance of one shaft, one speed after the other: few fit a large pair."""
    return jax.lax.map(lambda speed: unbalance_response(pair, unbalances, speed), speeds)


def _amplitudes(found: list[UnbalanceResponse]) -> Entries:
    each = lambda name: np.stack([getattr(response, name) for response in found])
    load = each("bearing_load")[..., :3]
    return (
        over(
            "gear speed",
            unbalance_frequency_Hz=(each("frequency") / (2.0 * np.pi), "rotation of that shaft"),
            unbalance_te_um=(np.abs(each("transmission_error")), "amplitude of the TE"),
            unbalance_mesh_force_N=(
                np.abs(each("mesh_force")),
                "amplitude of the mesh force along the normal",
            ),
        )
        | over(
            "gear speed bearing axis",
            unbalance_bearing_load_N=(np.abs(load), "amplitude of a bearing's load"),
        )
        | over(
            "gear speed bearing",
            unbalance_bearing_force_N=(
                _largest(load),
                "largest force on a bearing over a revolution of that shaft",
            ),
        )
    )


def _largest(load: np.ndarray) -> np.ndarray:
    r"""Half the long axis of the ellipse that $\Re(ae^{i\omega t})$ goes round, axes last."""
    # |Re(a e^iwt)|^2 = (|a|^2 + Re(a.a e^2iwt)) / 2.
    own, turned = np.sum(np.abs(load) ** 2, axis=-1), np.abs(np.sum(load**2, axis=-1))
    return np.sqrt(0.5 * (own + turned))


def _critical(speeds: dict[str, np.ndarray]) -> Entries:
    gears = [gear for gear, own in speeds.items() for _ in own]
    return {
        "critical_gear": Entry(("critical",), gears, "1", "shaft whose unbalance meets a mode"),
        "critical_speed_rad_s": Entry(
            ("critical",),
            np.concatenate(list(speeds.values())),
            "rad/s",
            "speed of the pinion at which it does, undamped",
        ),
    }


def _summary(dataset: xr.Dataset) -> Summary:
    """Of each shaft the largest amplitudes and the pinion speeds at which they are."""
    return {str(gear): _of_shaft(dataset.sel(gear=gear)) for gear in dataset["gear"].values}


def _of_shaft(own: xr.Dataset) -> Summary:
    found: Summary = {}
    for name in ("te_um", "mesh_force_N"):
        values = own[f"unbalance_{name}"].values
        place = int(np.argmax(values))
        found |= {name: values[place], f"{name}_at_rad_s": own["speed"].values[place]}
    force = own["unbalance_bearing_force_N"].transpose("bearing", "speed").values
    places = np.argmax(force, axis=1)
    critical = own["critical_speed_rad_s"].values[own["critical_gear"].values == own["gear"].values]
    # Those that are swept over, and the next.
    shown = critical[: np.searchsorted(critical, own["speed"].values[-1]) + 1]
    return found | {
        "bearings": [
            {"bearing": str(name), "force_N": row[place], "at_rad_s": own["speed"].values[place]}
            for name, row, place in zip(own["bearing"].values, force, places, strict=True)
        ],
        "critical_speeds_rad_s": shown,
    }


def _notes(dataset: xr.Dataset) -> Iterator[str]:
    """Where teeth would part: both shafts beat, so that their mesh forces add up at times."""
    force = dataset["unbalance_mesh_force_N"].sum("gear").values
    static, speeds = dataset.attrs["static_mesh_force_N"], dataset["speed"].values
    place = int(np.argmax(force))
    if force[place] > static:
        first = speeds[int(np.argmax(force > static))]
        yield Doubtful(
            f"Unbalance loads the mesh with {force[place]:.4g} N at {speeds[place]:.5g} rad/s, "
            f"more than its static {static:.4g} N, first at {first:.5g} rad/s: teeth part, and "
            "amplitudes that hold while they touch are only a warning there. Lower "
            "shaft.unbalance, or stay away from critical speeds."
        )
