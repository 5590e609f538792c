"""The fidelity levels of a scene: rules that say which models and methods are compared."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jaxgear as jg
from jaxgear._dynamics._adaptive import Adaptive
from jaxgear._units import um
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._fidelity._level import AXES, NOTHING, Changes, Level, own_of
from jaxgear.study._fidelity._rigid import rigid_changes

_BEYOND = "beyond the scene"
# Methods of sweeps that solve by harmonic balance, and its keys.
BY_BALANCE, OF_BALANCE = ("auto", "harmonic"), {"sweep.steps", "sweep.harmonics"}
# Positions in the period of the highest harmonic that a search looks at.
_IN_HARMONIC = 8
# Rules of time stepping, what they are called in short, and whether they are shot with and march
# on 64 steps.
_STEPPERS = {
    "midpoint": ("mid", jg.Midpoint, True, True),
    "exponential": ("exp", jg.Exponential, True, True),
    "Newmark": ("NM", jg.Newmark, False, True),
    "HHT": ("HHT", jg.HilberHughesTaylor, False, False),
    "generalised alpha": ("GA", jg.GeneralizedAlpha, False, False),
}

# Natural modes and excited shapes whose numbers are compared.
_NATURAL, _EXCITED = (10, 50, 100, 200, 400), (100, 150, 200, 250)


def _sliced(counts: Iterable[int]) -> Mapping[str, Changes]:
    return {f"{n} slice{'s' if n > 1 else ''}": {"mesh.slices": n} for n in counts}


@dataclasses.dataclass(frozen=True)
class Hierarchy:
    """The fidelity levels of a scene, from the cheapest models to those that judge.

    **Fields:**

    - `scene`: whose models they are; for `bodies` and `few`, with condensed bodies that vibrate.
    """

    scene: Scene

    def static(self, *, few: bool = False) -> list[Level]:
        """Models of the quasi-static cycle: the scene itself first, then family by family.

        With `few`, only those that can save time, and not more than are likely to.
        """
        # What is finer than the scene can save nothing, and takes long with condensed bodies.
        coarser = few or bool(self.scene.condensed)
        useful = lambda counts, own: [n for n in counts if n < own or (n > own and not coarser)]
        slices = (
            (1, 5, 10, 20, 40) if not few else () if needs_its_slices(self.scene.optimise) else (5,)
        )
        least = _IN_HARMONIC * max(self.scene.optimise.harmonics or (1.0,)) if few else 0
        phases = [n for n in ((16, 32) if few else (16, 32, 64, 128)) if n >= least]
        rows = [
            ("as given", {"as given": NOTHING}),
            ("bodies", self.simpler_bodies()),
            ("slices", _sliced(useful(slices, self.scene.mesh.slices))),
            (
                "phases",
                {f"{n} phases": {"mesh.phases": n} for n in useful(phases, self.scene.mesh.phases)},
            ),
        ]
        if self.scene.mesh.stiffness == "weber-banaschek":
            rows += self._on_stiffness(few)
        if not few:
            other = "smooth" if self.scene.mesh.contact == "exact" else "exact"
            rows.append(("contact", {f"{other} contact": {"mesh.contact": other}}))
        return [
            Level(name, family, family if family in AXES else "", x, beyond=family == _BEYOND)
            for family, changes in rows
            for name, x in changes.items()
            if not self.takes_away(x)
        ]

    def simpler_bodies(self) -> Mapping[str, Changes]:
        """What makes the bodies of a scene simpler: changes of keys, by the name of the level.

        Condensed bodies and beams are made rigid, each alone and together, with and without a
        foundation; the pair without shafts and bearings only turns.
        """
        elastic = [gear for gear in GEARS if self.scene.gear(gear).body.kind != "rigid"]
        rigid = {f"{gear}.body.kind": "rigid" for gear in elastic}
        bare = {f"{gear}.foundation": "none" for gear in self.scene.condensed}
        mounts = [
            mount
            for mount in (f"{gear}.{part}" for gear in GEARS for part in ("shaft", "support"))
            if any(key.startswith(f"{mount}.") for key in self.scene.values)
        ]
        loaded = any(self.scene.gear(gear).shaft.loads for gear in GEARS)
        rules = [
            ("rigid pinion", len(elastic) == len(GEARS), {"pinion.body.kind": "rigid"}),
            ("rigid bodies", elastic, rigid),
            ("rigid bodies, no foundation", bare, rigid | bare),
            (
                "torsional pair",
                mounts and not loaded and self.scene.housing.stiffness_csv is None,
                rigid | dict.fromkeys(mounts),
            ),
        ]
        return {name: changes for name, holds, changes in rules if holds}

    def _on_stiffness(self, few: bool) -> list[tuple[str, Mapping[str, Changes]]]:
        """Foundations and line loads: less than the scene has, and what lies beyond it."""
        key, updates = "mesh.line_load_updates", self.scene.mesh.line_load_updates
        chosen = {
            f"{gear}.foundation": self.scene.gear(gear).foundation or self.scene.mesh.foundation
            for gear in GEARS
            if gear not in self.scene.condensed
        }
        less = {key: "weber" for key, name in chosen.items() if name == "ring"}
        none = {key: "none" for key, name in chosen.items() if name != "none"}
        coupled = self.scene.mesh.face_coupling == "coupled"
        rules = [
            ("foundation", "Weber foundation", less, less),
            ("face coupling", "slices apart", coupled, {"mesh.face_coupling": "none"}),
            ("line loads", "nominal line load", updates, {key: 0}),
            ("foundation", "no foundation", none and not few, none),
            (_BEYOND, "2 line load updates", not updates and not few, {key: 2}),
        ]
        return [(family, {name: changes}) for family, name, holds, changes in rules if holds]

    # --- In motion

    def _of_models(self, slices: Iterable[int], harmonics: int, steps: int) -> list[Level]:
        """Other slices and simpler bodies, by harmonic balance."""
        by, numbers = f"H{harmonics} N{steps}", {"sweep.harmonics": harmonics, "sweep.steps": steps}
        return [
            Level(name, f"its {axis}, {by}", axis, self.scene.differing({**x, **numbers}))
            for axis, changes in (("slices", _sliced(slices)), ("bodies", self.simpler_bodies()))
            for name, x in changes.items()
        ]

    def _by_balance(
        self, settings: Iterable[tuple[int, int]], family: str = "harmonic balance"
    ) -> list[Level]:
        """Harmonic balance with so many harmonics and time steps."""
        changes = lambda h, n: self.scene.differing({"sweep.harmonics": h, "sweep.steps": n})
        ordered = sorted(settings, key=lambda pair: (pair[1], pair[0]))
        return [Level(f"H{h} N{n}", family, "method", changes(h, n)) for h, n in ordered]

    def methods(self) -> list[Level]:
        """All methods and settings that are compared on a scene of rigid bodies and beams."""
        own, width = self.scene.mesh.slices, float(self.scene.mesh.smoothing_um)
        settings = {(5, 64), (10, 64), (20, 64), (20, 128), (40, 128), (40, 256)}

        def level(name: str, family: str, method: Any, steps: int, **more: Any) -> Level:
            changes = self.scene.differing({"sweep.steps": steps})
            return Level(name, family, "method", changes, method, **more)

        def balance(name: str, family: str, h: int, n: int, averaged: bool = False) -> Level:
            method = jg.HarmonicBalance(harmonics=h, averaged=averaged)
            return level(f"H{h} N{n} {name}", family, method, n, batched=not averaged)

        averaged = () if self.scene.damping.active_mesh else ((10, 64), (20, 128), (40, 256))
        return [
            *self._by_balance(settings | {(self.scene.sweep.harmonics, self.scene.sweep.steps)}),
            *(balance("vmap", "its speeds batched", h, n) for h, n in ((10, 64), (20, 128))),
            *(balance("mean", "its contact averaged", h, n, averaged=True) for h, n in averaged),
            *(
                level(
                    f"{part * width:g} um",
                    "its contact smooth, H20 N128",
                    jg.HarmonicBalance(law=jg.SmoothContact(part * width * um)),
                    128,
                )
                for part in (0.1, 0.3, 1.0, 3.0)
            ),
            *self._of_models(sorted({1, 5, own, 2 * own}), 20, 128),
            *(
                level(f"{short} N{n}", f"shooting, {name}", jg.Shooting(stepper=stepper()), n)
                for name, (short, stepper, is_shot, _) in _STEPPERS.items()
                if is_shot
                for n in (64, 128, 256)
            ),
            *(
                level(
                    f"{short} {n}x{c}",
                    f"time stepping, {name}",
                    jg.TimeStepping(stepper=stepper(), cycles=c),
                    n,
                )
                for name, (short, stepper, _, is_coarse) in _STEPPERS.items()
                for n, c in ((64, 100), (128, 100), (128, 400))
                if n > 64 or is_coarse
            ),
            level(
                "Tsit5 1e-4",
                "diffrax, 50 cycles",
                Adaptive(law=jg.SmoothContact(0.1 * width * um)),
                128,
                thinned=10,
            ),
        ]

    def moving(self) -> list[Level]:
        """The few levels of rigid bodies in motion to choose from; the scene's own first."""
        h, n = self.scene.sweep.harmonics, self.scene.sweep.steps
        return [
            *self._by_balance([(h, n)]),
            *self._by_balance([(fewer, 64) for fewer in (5, 10) if fewer < h and n >= 64]),
            *self._of_models([count for count in (1, 5) if count < self.scene.mesh.slices], h, n),
        ]

    def bodies(self, most: int) -> list[Level]:
        """All models and settings that are compared on a scene with condensed bodies.

        From the scene's own bodies, slices, steps and harmonics one thing is changed at a time; of
        each body at most `most` natural modes are retained, of 0 all, or some excited shapes.
        """
        at_mesh = self.scene.at_mesh
        settings = {(5, 64), (10, 64), (20, 64), (10, 128), (40, 128)}
        rigid = model_of(
            self.scene, {f"{gear}.body.kind": "rigid" for gear in self.scene.condensed}
        )
        rows: dict[str, Mapping[str, Changes]] = {
            "modes": self._of_shapes(most),
            "mesh coordinates": {
                f"{n} coordinates": {"model.mesh_coordinates": n}
                for n in (6, 12, 24)
                if n != at_mesh
            },
            "slices": _sliced(n for n in (5, 10, 20) if n < self.scene.mesh.slices),
            "bodies": rigid_changes(self.scene.bodies, rigid),
        }
        march, shot = jg.TimeStepping(stepper=jg.Newmark(), cycles=200), jg.Shooting(warm_up=10)
        coarse = self.scene.differing({"sweep.steps": 64})
        return [
            *(Level(name, axis, axis, x) for axis, row in rows.items() for name, x in row.items()),
            *self._by_balance(
                settings - {(self.scene.sweep.harmonics, self.scene.sweep.steps)},
                "harmonics and steps",
            ),
            Level("NM 64x200", "time stepping, Newmark", "", coarse, march, thinned=4),
            Level("exp N64", "shooting, exponential", "", coarse, shot, thinned=4),
        ]

    def _of_shapes(self, most: int) -> Mapping[str, Changes]:
        """More or fewer shapes of condensed bodies, natural ones first, by rising number."""
        every = max(body.built.body.dofs for body in self.scene.bodies.values())
        limit, own = min(most or every, every), (self.scene.model.shapes, self.scene.shape_count)
        wanted = {("natural", n) for n in (*_NATURAL, most) if n <= limit}
        wanted |= {("excited", n) for n in _EXCITED if n < limit} | {own}
        words = {"natural": "modes", "excited": "excited shapes"}
        ordered = sorted(wanted, key=lambda each: (each[0] == "excited", each[1] or math.inf))
        changes = lambda shapes, n: {"model.shapes": shapes, "model.coordinates": n}
        return {
            f"{n or 'all'} {words[shapes]}": {} if (shapes, n) == own else changes(shapes, n)
            for shapes, n in ordered
        }

    def few(self) -> list[Level]:
        """The scene itself, and the few levels that are likely to be cheaper and to suffice."""
        levels = self.bodies(self.scene.shape_count)
        own = own_of(levels)
        wanted = ("50 modes", "100 modes", "100 excited shapes", "5 slices", "H10 N64", "rigid")
        wanted = (*wanted, "rigid pinion")
        return [own, *(level for level in levels if level.name in wanted and level is not own)]

    # --- What a search needs

    def able(self, levels: Sequence[Level]) -> list[Level]:
        """Of levels in motion, its own first, those that still do what the scene asks for."""
        scene = self.scene
        watched = [f"{probe.gear}.body.probes" for probe in scene.probes]

        def is_able(level: Level) -> bool:
            if needs_its_slices(scene.optimise) and "mesh.slices" in level.changes:
                return False
            # Another method of the user's is not overruled: only slices and bodies are chosen then.
            by_other = level.method is not None or level.changes.keys() & OF_BALANCE
            if by_other and scene.sweep.method not in BY_BALANCE:
                return False
            return not self.takes_away(level.changes, watched)

        return [level for level in levels if is_able(level)]

    def takes_away(self, changes: Changes, more: Sequence[str] = ()) -> bool:
        """Whether changes of a scene take away what its search names, or one of `more` keys."""
        tables = [key for key, value in changes.items() if value is None]
        tables += [key.removesuffix(".kind") for key in changes if key.endswith(".body.kind")]
        named = [*self._named(), *more]
        return any(key.startswith(f"{table}.") for key in named for table in tables)

    def _named(self) -> list[str]:
        """Keys that a search varies, ties, lets scatter or looks at."""
        if not self.scene.optimise.is_given:
            return []
        forces = "bearing_force" in (
            *self.scene.optimise.weights,
            self.scene.optimise.pareto.against,
        )
        bearings = [f"{gear}.shaft.bearings" for gear in GEARS] if forces else []
        tables = ("optimise.ties.", "robust.scatter.", "robust.even.")
        others = [key.removeprefix(table) for table in tables for key in self.scene.values
                  if key.startswith(table)]  # fmt: skip
        return [*self.scene.optimise.vary, *others, *bearings]


def needs_its_slices(asked: OptimiseKeys) -> bool:
    """Whether a search limits the load of the last slices, which other slices have not."""
    limited = asked.limits.edge_line_load_N_mm is not None
    return limited and asked.is_given
