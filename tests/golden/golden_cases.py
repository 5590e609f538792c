"""What is kept: commands on all example scenes, coarse enough to take seconds each."""

_COARSE = ("mesh.slices=4", "mesh.phases=16")
_MAP = ("map.depth_um.points=5", "map.extent.points=5", "map.extent.from=0.05")
_SWEEP = (
    "sweep.pinion_speed_rad_s=[400.0, 900.0, 1300.0]",
    "sweep.steps=32",
    "sweep.harmonics=6",
)
# Bodies of few elements and modes; the web, rim and shaft stay those of the scene.
_FINENESS = (
    "{gear}.body.fineness.rim_across=2",
    "{gear}.body.fineness.web_along=2",
    "{gear}.body.fineness.hub_deep=1",
    "{gear}.body.modes=12",
    "{gear}.body.compare_seats=false",
)
_BODY = tuple(each.format(gear="wheel") for each in _FINENESS)
_BODIES = _BODY + tuple(each.format(gear="pinion") for each in _FINENESS)
_HYBRID = ("model.coordinates=16", "model.mesh_coordinates=6")
_SIZING = (
    'sizing.amounts={"flank.pinion.tip_relief.depth_um"=[0.0, 20.0]}',
    "sizing.symmetric=true",
)
_ROBUST = (
    'robust.scatter={"flank.pinion.tip_relief.depth_um"=1.5, "pair.torque_pinion_Nm"=8.0}',
    "robust.samples=32",
)

# Name of the case: example scene, command, what is set.
CASES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "accessory-run": ("accessory", "run", _COARSE),
    "accessory-run-sweep": ("accessory", "run", (*_COARSE, *_SWEEP, "sweep.direction=both")),
    "accessory-run-sizing": (
        "accessory",
        "run",
        (*_COARSE, *_SIZING, "mesh.friction_coefficient=0.05"),
    ),
    "accessory-map": ("accessory", "map", (*_COARSE, *_MAP, "map.torques_Nm=[60.0, 80.0]")),
    "accessory-optimise": ("accessory", "optimise", (*_COARSE, "optimise.torques_Nm=[60.0, 80.0]")),
    "accessory-robust": ("accessory", "optimise", (*_COARSE, *_ROBUST)),
    "accessory-pareto": (
        "accessory",
        "optimise",
        (*_COARSE, 'optimise.pareto.against="max_pressure"', "optimise.pareto.points=3"),
    ),
    "accessory-sweep": ("accessory", "sweep", (*_COARSE, *_SWEEP)),
    "accessory-newmark": ("accessory", "sweep", (*_COARSE, *_SWEEP, 'sweep.method="newmark"')),
    "accessory-modes": ("accessory", "modes", _COARSE),
    "accessory-check-grad": ("accessory", "check-grad", (*_COARSE, 'mesh.foundation="weber"')),
    "accessory-sensitivity": ("accessory", "sensitivity", _COARSE),
    "accessory-compare": ("accessory", "compare", _COARSE),
    "power-run": ("power", "run", _COARSE),
    "power-optimise": ("power", "optimise", _COARSE),
    "power-map": ("power", "map", (*_COARSE, *_MAP)),
    "power-modes": ("power", "modes", _COARSE),
    "power-sweep": ("power", "sweep", (*_COARSE, *_SWEEP)),
    "accessory-h1-condense": ("accessory-h1", "condense", _BODY),
    "accessory-h1-run": ("accessory-h1", "run", (*_COARSE, *_BODY)),
    "accessory-h1-modes": ("accessory-h1", "modes", (*_COARSE, *_BODY, *_HYBRID)),
    "accessory-h1-sweep": ("accessory-h1", "sweep", (*_COARSE, *_BODY, *_HYBRID, *_SWEEP)),
    "accessory-h1-map": ("accessory-h1", "map", (*_COARSE, *_BODY, *_MAP)),
    "accessory-h2-run": ("accessory-h2", "run", (*_COARSE, *_BODIES, "mesh.slices=3")),
    "power-h1-run": ("power-h1", "run", (*_COARSE, *_BODY)),
    "power-h1-sweep": ("power-h1", "sweep", (*_COARSE, *_BODY, *_HYBRID, *_SWEEP)),
    "power-h2-modes": ("power-h2", "modes", (*_COARSE, *_BODIES, *_HYBRID)),
    "power-holes-run": ("power-holes", "run", (*_COARSE, *_BODY, "mesh.phases=8")),
    "power-webbed-pinion-run": ("power-webbed-pinion", "run", (*_COARSE, *_BODIES)),
}
