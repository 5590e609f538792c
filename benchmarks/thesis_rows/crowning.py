"""Which flanks a fast web wants: crowning, relief, slope, by gradient."""

import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
import optimise

from .finding import Finding
from .leads import (
    BALANCE,
    KINDS,
    LAW,
    LEFT_HANDED,
    PLAIN,
    RELIEFS,
    SPEED,
    WEBS,
    WIDTHS,
    Across,
    Motion,
    Optimum,
    across,
    corrected,
    in_motion,
    only,
    optimum,
    pair_with,
)


def webs(labels: Sequence[str] = tuple(WEBS), hand: str = "right") -> Finding:
    """Fig. IV-43, IV-44: the load across the face, at rest and at speed."""
    found = Finding(
        f"Pressure across the face without corrections, {hand}-handed pinion (Fig. IV-43, IV-44)",
        "at rest: more centred and more even, the thinner the web; at 3000 rad/s: peaks at the "
        "ends of the face, the largest on the other side than at rest, E most affected",
        ["web", "rad/s", "left MPa", "mid", "right", "largest", "at", "offset", "K_Hbeta"],
    )
    rows: dict[tuple[str, bool], Across] = {}
    for label in labels:
        for still in (True, False):
            each = rows[label, still] = across(label, PLAIN, still=still)
            middle = float(each.pressure[len(each.pressure) // 2])
            row = [each.pressure[0], middle, each.pressure[-1], each.highest, each.place()]
            row += [each.offset, each.evenness]
            found.rows.append([label, 0.0 if still else SPEED, *(float(x) for x in row)])
    rest, fast = ([rows[label, still] for label in labels] for still in (True, False))
    found.holds = {
        "at rest the load is more even, the thinner the web": rest[0].evenness
        > rest[1].evenness
        > rest[2].evenness,
        "at rest the pressure is more centred, the thinner the web": abs(rest[0].offset)
        > abs(rest[1].offset)
        > abs(rest[2].offset),
        "the largest pressure is on the other side at speed": all(
            a.place() * b.place() < 0.0 for a, b in zip(rest, fast, strict=True)
        ),
        "at speed it is at an end of the face": all(abs(x.place()) > 0.85 for x in fast),
        "E is changed most by rotation": abs(fast[2].highest / rest[2].highest - 1.0)
        == max(abs(b.highest / a.highest - 1.0) for a, b in zip(rest, fast, strict=True)),
    }
    return found


DEPTHS = (0.0, 2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 20.0)


def crowning(labels: Sequence[str] = tuple(WEBS), hand: str = "right") -> Finding:
    """Fig. IV-47 to IV-50: crowning of the pinion at speed."""
    found = Finding(
        f"Crowning of the {hand}-handed pinion at 3000 rad/s (Fig. IV-47 to IV-50)",
        "the more, the better centred; beyond 10 um the ends are less and less loaded; mesh force "
        "oscillations grow with crowning; 10 um a good compromise",
        [
            "web",
            "crowning um",
            "largest MPa",
            "at",
            "offset",
            "left end N/mm",
            "right end",
            "TE RMS um",
            "dynamic ratio",
            "largest there MPa",
        ],
    )
    rows: dict[str, list[tuple[Across, Motion]]] = {}
    for label in labels:
        for depth in DEPTHS:
            each, moved = (
                across(label, only("crowning", depth)),
                in_motion(label, only("crowning", depth)),
            )
            rows.setdefault(label, []).append((each, moved))
            row = [each.highest, each.place(), each.offset, *each.ends, each.rms]
            row += [moved.ratio, moved.pressure.max()]
            found.rows.append([label, depth, *(float(x) for x in row)])
    ten = DEPTHS.index(10.0)
    every = rows.values()
    found.holds = {
        "the largest pressure moves towards mid-face": all(
            abs(own[ten][0].place()) < abs(own[0][0].place()) for own in every
        ),
        "the centre of the pressure comes closer to mid-face": all(
            abs(own[ten][0].offset) < abs(own[0][0].offset) for own in every
        ),
        "the ends are less and less loaded": all(
            np.all(np.diff([x.ends.sum() for x, _ in own]) < 0.0) for own in every
        ),
        "of these the largest pressure is least between 5 and 15 um": all(
            5.0 <= DEPTHS[int(np.argmin([x.highest for x, _ in own]))] <= 15.0 for own in every
        ),
        "the dynamic ratio grows from no crowning on": all(
            np.all(np.diff([m.ratio for _, m in own]) > 0.0) for own in every
        ),
        "... from 10 um on": all(
            np.all(np.diff([m.ratio for _, m in own[ten:]]) > 0.0) for own in every
        ),
    }
    return found


SHAPES: dict[str, tuple[str, tuple[str, ...]]] = {
    "crowning, even": ("even", ("crowning",)),
    "crowning, centred": ("centred", ("crowning",)),
    "elliptical, even": ("even", ("elliptical",)),
    "end relief, even": ("even", ("relief",)),
    "end relief, centred": ("centred", ("relief",)),
    "slope + crowning, even": ("even", ("slope", "crowning")),
    "slope + elliptical, even": ("even", ("slope", "elliptical")),
    "relief + crowning, even": ("even", ("relief", "crowning")),
}


def shapes(labels: Sequence[str] = tuple(WEBS), hand: str = "right") -> Finding:
    """Fig. IV-33, IV-34 and p. 168: which shape does best, found by gradient."""
    found = Finding(
        f"Corrections of the {hand}-handed pinion that centre the pressure, or make it least, at "
        "3000 rad/s (Fig. IV-33, IV-34, IV-46)",
        "crowning of about 10 um; linear relief of 10 um over 0.4 of the face at the loaded end "
        "centres the pressure; elliptical, or linear and parabolic, might be better",
        [
            "web",
            "what",
            *(f"{kind} um" for kind in KINDS),
            "largest MPa",
            "offset",
            "K_Hbeta",
            "dynamic ratio",
            "gradients",
            "s",
        ],
    )
    by: dict[tuple[str, str], tuple[Optimum, Across]] = {}
    for label in labels:
        for what in ("plain", *SHAPES):
            best = Optimum(np.zeros(len(KINDS)), 0, 0.0)
            if what != "plain":
                best = optimum(label, *SHAPES[what])
            each = across(label, list(best.depths))
            by[label, what] = best, each
            ratio = in_motion(label, list(best.depths)).ratio
            row = [*best.depths, each.highest, each.offset, each.evenness, ratio]
            row += [best.evaluations, best.seconds]
            found.rows.append([label, what, *(float(x) for x in row)])
    depth = lambda label, what, kind: float(by[label, what][0].depths[KINDS.index(kind)])
    least = lambda label, what: by[label, what][1].highest
    found.holds = {
        "the crowning of least pressure lies between 7.5 and 12.5 um": all(
            7.5 <= depth(label, "crowning, even", "crowning") <= 12.5 for label in labels
        ),
        "crowning alone centres the pressure to 1 % of half the face": all(
            abs(by[label, "crowning, centred"][1].offset) < 0.01 for label in labels
        ),
        "linear relief of the loaded end centres it to 1 %": all(
            abs(by[label, "end relief, centred"][1].offset) < 0.01 for label in labels
        ),
        "... with 7.5 to 12.5 um": all(
            7.5 <= max(depth(label, "end relief, centred", kind) for kind in RELIEFS) <= 12.5
            for label in labels
        ),
        "linear + parabolic has a lower pressure than crowning alone": all(
            least(label, "slope + crowning, even") < least(label, "crowning, even")
            for label in labels
        ),
        "elliptical has a lower pressure than parabolic crowning": all(
            least(label, "elliptical, even") < least(label, "crowning, even") for label in labels
        ),
        "each search within 60 s without compiling": all(x.seconds < 60.0 for x, _ in by.values()),
    }
    return found


def transfer() -> Finding:
    """Fig. IV-49 and p. 167: whether the optimum of one web serves another."""
    found = Finding(
        "Optimum of one web on another, at 3000 rad/s (Fig. IV-49)",
        "lead modification cannot be directly transposed from one web to another",
        ["what", "found for", "used on", "largest MPa", "over its own %", "offset"],
    )
    worse: dict[str, list[float]] = {}
    offset: dict[str, list[float]] = {}
    for what in ("crowning, even", "end relief, centred", "slope + crowning, even"):
        own = {label: optimum(label, *SHAPES[what]).depths for label in WEBS}
        best = {label: across(label, list(own[label])) for label in WEBS}
        for i in WEBS:
            for j in WEBS:
                each = across(j, list(own[i]))
                over = 100.0 * (each.highest / best[j].highest - 1.0)
                found.rows.append([what, i, j, each.highest, over, each.offset])
                worse.setdefault(what, []).append(over)
                offset.setdefault(what, []).append(abs(each.offset))
    found.holds = {
        **{
            f"{what}: another web's optimum costs more than 2 % of pressure somewhere": max(over)
            > 2.0
            for what, over in worse.items()
            if what.endswith("even")
        },
        "end relief: another web's leaves the pressure off by more than 2 % of half the face": max(
            offset["end relief, centred"]
        )
        > 0.02,
    }
    return found


def front() -> Finding:
    """P. 167: pressure against mesh force oscillations, as a Pareto front by gradient."""
    found = Finding(
        "Largest pressure against dynamic ratio at 3000 rad/s, web O, helix slope and crowning of "
        "the pinion free (p. 167)",
        "a compromise between load pattern quality and dynamic forces, at about 10 um of crowning",
        ["design", "slope um", "crowning um", "largest MPa", "dynamic ratio", "counts"],
    )
    pair = pair_with("O")

    @eqx.filter_jit
    def both(model, prepared, damping, point):
        def numbers(point):
            own = corrected(model, jnp.zeros(len(KINDS)).at[jnp.asarray([4, 0])].set(point))
            cycle = jg.corrected_cycle(prepared, own, law=LAW)
            pressure = optimise.LargestPressure(WIDTHS[1])(own, cycle, LAW)
            system = jg.pair_dynamics(own, pair.grid, damping).system
            orbit = jg.steady_state(system, jnp.asarray(SPEED), BALANCE)
            return (
                jnp.stack([pressure, jg.smooth_dynamic_ratio(system, orbit, jnp.asarray(2e-3))]),
            ) * 2

        return jax.jacfwd(numbers, has_aux=True)(point)[::-1]

    def slopes(point):
        return both(pair.model, pair.quick, pair.damping, jnp.asarray(point))

    def exact(point: np.ndarray) -> np.ndarray:
        depths = [point[1], 0.0, 0.0, 0.0, point[0]]
        return np.asarray([across("O", depths).highest, in_motion("O", depths).ratio])

    box = optimise.Box([-40.0, 0.0], [10.0, 20.0])
    made = optimise.pareto_front(
        optimise.ValueAndGradient(slopes), np.asarray([-5.0, 5.0]), box, points=7, exact=exact
    )
    rows = zip(made.point, made.value, made.dominated, strict=True)
    for i, (point, value, dominated) in enumerate(rows):
        row = [float(x) for x in (*point, *value)]
        found.rows.append([str(i + 1), *row, "no" if dominated else "yes"])
    plain = exact(np.zeros(2))
    ten = exact(np.asarray([0.0, 10.0]))
    for name, point, value in (("plain", (0.0, 0.0), plain), ("crowning", (0.0, 10.0), ten)):
        found.rows.append([name, *point, *(float(x) for x in value), "no"])
    span = np.ptp(made.front, axis=0) / made.front.min(axis=0)
    found.holds = {
        "pressure and dynamic ratio are at odds: the front spans more than 1 % of both": bool(
            np.all(span > 0.01)
        ),
        "every design of the front is better than 10 um of crowning in both": bool(
            np.all(made.front < ten)
        ),
    }
    return found


def coupling() -> Finding:
    """What of the flanks for web O changes where slices feel each other; without motion."""
    found = Finding(
        "Slices apart and slices that feel each other, web O at 3000 rad/s",
        "none: the thesis has slices apart",
        ["slices", "flank", "crowning um", "slope um", "relief um", "largest MPa", "offset"],
    )
    largest: dict[str, dict[str, float]] = {}
    for label in ("O", "O, coupled"):
        depths = {"plain": only("crowning", 0.0), "10 um of crowning": only("crowning", 10.0)}
        for shape in ("crowning, even", "slope + crowning, even", "end relief, centred"):
            depths[shape] = optimum(label, *SHAPES[shape]).depths.tolist()
        largest[label] = own = {}
        for name, each in depths.items():
            seen, at = across(label, each), dict(zip(KINDS, each, strict=True))
            own[name] = seen.highest
            row = [at["crowning"], at["slope"], at["relief"], seen.highest, seen.offset]
            found.rows.append([label, name, *row])
    apart, felt = largest["O"], largest["O, coupled"]
    ranked = lambda own: sorted(own, key=lambda name: own[name])
    found.holds = {
        "pressure is higher where slices feel each other": all(felt[x] > apart[x] for x in felt),
        "flanks stay in the same order": ranked(apart) == ranked(felt),
    }
    return found


webs_left = functools.partial(webs, tuple(LEFT_HANDED), "left")
