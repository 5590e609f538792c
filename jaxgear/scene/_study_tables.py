"""Tables of a scene that ask for work: map, search, scatter, sizing, comparison."""

from collections.abc import Mapping
from typing import Literal

from jaxgear.scene._gear_tables import DEPTH, EXTENT, TORQUE
from jaxgear.scene._table import AbstractKeys, key

Combined = Literal["mean", "worst"]
# What can be made small, or traded.
Minimised = Literal[
    "te_rms",
    "te_peak_to_peak",
    "te_harmonics",
    "max_pressure",
    "max_root_stress",
    "max_gauge_stress",
    "gauge_stress_amplitude",
    "face_load_factor",
    "pressure_offset",
    "dynamic_ratio",
    "bearing_force",
]
# What `compare` compares: of the quasi-static cycle, and in motion.
StaticResponse = Literal[
    "te_mean",
    "te_rms",
    "te_peak_to_peak",
    "max_line_load",
    "max_pressure",
    "mesh_stiffness_mean",
    "max_root_stress",
]
DynamicResponse = Literal["dynamic_ratio", "te_rms", "te_mean"]


class DepthRangeKeys(AbstractKeys):
    """Depths of the map: `[map.depth_um]`."""

    from_: float = key("smallest depth", DEPTH, 0.0)
    to: float | None = key("largest depth; default: chosen by the program", "(0, inf)")
    points: int = key("number of depths", "[2, 2000]", 50)


class ExtentRangeKeys(AbstractKeys):
    """Extents of the map: `[map.extent]`."""

    from_: float = key("smallest extent", EXTENT, 0.01)
    to: float = key("largest extent", EXTENT, 0.5)
    points: int = key("number of extents", "[2, 2000]", 50)


class MapKeys(AbstractKeys):
    """The Master Curve map: `[map]`."""

    depth_um: DepthRangeKeys
    extent: ExtentRangeKeys
    torques_Nm: list[float] | None = key(
        "pinion torques of the Harris map, and of Master Curves", TORQUE
    )


class WeightsKeys(AbstractKeys):
    """Weights of what is minimised: `[optimise.minimise]`."""

    te_rms: float | None = key("weight of static.te_rms_um", "[0, inf)")
    te_peak_to_peak: float | None = key("weight of static.te_peak_to_peak_um", "[0, inf)")
    te_harmonics: float | None = key("weight of the chosen harmonics", "[0, inf)")
    max_pressure: float | None = key("weight of static.max_pressure_MPa", "[0, inf)")
    max_root_stress: float | None = key(
        "weight of the largest stress of the fillets, of both gears", "[0, inf)"
    )
    max_gauge_stress: float | None = key(
        "weight of the largest principal stress at the gauges", "[0, inf)"
    )
    gauge_stress_amplitude: float | None = key(
        "weight of the largest half range of the stress along the gauges", "[0, inf)"
    )
    face_load_factor: float | None = key("weight of the face load factor", "[0, inf)")
    pressure_offset: float | None = key(
        "weight of the squared offset of the pressure from mid-face, over half the face", "[0, inf)"
    )
    dynamic_ratio: float | None = key(
        "weight of the dynamic ratio over the speeds of [sweep]", "[0, inf)"
    )
    bearing_force: float | None = key(
        "weight of the RMS of the bearings' forces over the speeds of [sweep], in N", "[0, inf)"
    )


class LimitsKeys(AbstractKeys):
    """What a search may not exceed: `[optimise.limits]`."""

    max_pressure_MPa: float | None = key("largest pressure allowed", "(0, inf)")
    max_root_stress_MPa: float | None = key(
        "largest tensile stress of the fillets allowed, of both gears", "(0, inf)"
    )
    max_gauge_stress_MPa: float | None = key(
        "largest principal stress allowed at the gauges over a revolution", "(0, inf)"
    )
    gauge_stress_amplitude_MPa: float | None = key(
        "largest half range of the stress along the gauges allowed", "(0, inf)"
    )
    te_peak_to_peak_um: float | None = key(
        "largest peak to peak of the transmission error allowed", "(0, inf)"
    )
    face_load_factor: float | None = key("largest face load factor allowed", "(1, inf)")
    edge_line_load_N_mm: float | None = key(
        "largest line load on the first and the last slice allowed", "(0, inf)"
    )


class ParetoKeys(AbstractKeys):
    """A trade between two objectives: `[optimise.pareto]`."""

    against: Minimised | None = key(
        "what optimise.minimise is traded against, design by design: the largest over the "
        "torques; left out: nothing"
    )
    points: int = key("designs to look for", "[2, 200]", 7)


class OptimiseKeys(AbstractKeys):
    """A search: `[optimise]`."""

    vary: list[str] = key("the keys that the optimiser may change")
    symmetric: bool = key("pinion and wheel get the same relief", default=False)
    minimise: Minimised | WeightsKeys = key(
        "what to minimise; a table of weights is allowed too", default="te_rms"
    )
    harmonics: list[float] | None = key(
        "mesh harmonics that te_harmonics counts; default: the first", "[1, 1000]"
    )
    smoothing_ratio: float = key(
        "width of the smooth maximum of the dynamic ratio, in static mesh forces", "(0, 1]", 0.02
    )
    over_speeds: Combined = key("how the numbers of the speeds are combined", default="mean")
    torques_Nm: list[float] | None = key("pinion torques; default: that of the pair", TORQUE)
    over: Combined = key("how torques are combined", default="mean")
    method: Literal["lbfgs", "adam", "least_squares"] = key(
        "method of the search; with [optimise.limits] SLSQP takes its place", default="lbfgs"
    )
    starts: int | None = key(
        "searches, from the scene itself and from the best of 128 points in the bounds, in motion "
        "of 16; default: 5, in motion 2",
        "[1, 64]",
    )
    limits: LimitsKeys
    anneal_um: list[float] | None = key(
        "widths of smooth contact to search with before mesh.smoothing_um, falling", "(0, 1000]"
    )
    max_evaluations: int = key("most evaluations of a search", "[1, 1000000]", 100)
    pareto: ParetoKeys
    bounds: Mapping[str, list[float]]
    ties: Mapping[str, str]

    @property
    def alone(self) -> str | None:
        """The one thing that is made small; `None` of a weighted sum."""
        return self.minimise if isinstance(self.minimise, str) else None

    @property
    def weights(self) -> Mapping[str, float]:
        """What is made small, by name, and its weight."""
        if isinstance(self.minimise, str):
            return {self.minimise: 1.0}
        return {name: weight for name, weight in self.minimise.values.items() if weight is not None}


class RobustKeys(AbstractKeys):
    """Scatter that a search looks at: `[robust]`."""

    measure: Literal["mean", "quantile"] = key(
        "what of the objective over the sample is minimised", default="quantile"
    )
    share: float = key(
        "share of the gears that stays below the quantile",
        "(0, 1). It is a share, not a percentage: 0.95 for 95 %",
        0.95,
    )
    samples: int = key(
        "gears in the sample that is searched with; a power of two", "[8, 65536]", 256
    )
    fresh_samples: int = key(
        "gears in the sample that judges the result; a power of two", "[8, 65536]", 1024
    )
    seed: int = key("seed of the samples; the fresh ones have the next one", "[0, inf)", 0)
    accuracy_grade: float | None = key(
        "ISO 1328-1 class whose profile, helix and pitch deviations both gears have at random; "
        "left out: none",
        "[1, 11]. Classes of ISO 1328-1:2013 lie between 1 and 11",
    )
    tolerance_deviations: float = key(
        "standard deviations of these that fit into their tolerance", "(0, 10]", 3.0
    )
    scatter: Mapping[str, float]
    even: Mapping[str, float]


class SizingKeys(AbstractKeys):
    """Amounts of relief to try: `[sizing]`."""

    torques_Nm: list[float] | None = key("pinion torques; default: that of the pair", TORQUE)
    symmetric: bool = key("pinion and wheel get the same amounts", default=True)
    amounts: Mapping[str, list[float]]


class CompareKeys(AbstractKeys):
    """Models against each other: `[compare]`."""

    tolerance: float = key(
        "error that is good enough, relative",
        "(0, 1). It is a share, not a percentage: 0.02 is 2 %",
        0.02,
    )
    responses: list[StaticResponse | DynamicResponse] | None = key(
        "responses that count for the recommendation; default: all"
    )
    teeth: Literal["own", "elements"] = key(
        "what judges models of the teeth at rest: the scene's own on more slices, or condensed "
        "finite elements of whole teeth besides, which take some minutes once",
        default="own",
    )
