"""The texts that users meet when a scene is wrong: some hundreds, in one file."""

import tempfile
from pathlib import Path

from jaxgear.scene._scene import READY, SceneError, read_scene
from jaxgear.scene._schema import KEYS

MISTAKES = "mistakes"

# Scenes that no key alone makes wrong.
_TOGETHER = (
    ("pinion.teeth=4",),
    ("pinion.profile_shift=3.0",),
    ("pair.centre_distance_mm=90.0",),
    ("pair.pressure_angle_deg=5.0",),
    ("wheel.bore_mm=140.0",),
    ("pinion.bore_mm=80.0",),
    ("flank.pinion.tip_relief={depth_um=20.0, extent=0.7}",),
    ("mesh.slices=0",),
    ("mesh.slices=1.5",),
    ("pinion.shaft.bearings=[]",),
    ("pinion.shaft.gear_at_mm=200.0",),
    ('optimise.vary=["flank.pinion.tip"]',),
    ('optimise.vary=["pinion.teeth"]',),
    ("optimise.vary=[]",),
    ('optimise.bounds={"flank.pinion.tip_relief.depth_um"=[5.0, 1.0]}',),
    ("sweep.pinion_speed_rad_s=[]",),
    ("sweep.pinion_speed_rad_s=[100.0, -3.0]",),
    ('sweep.direction="sideways"',),
    ("map.extent.to=0.9",),
    ("map.depth_um.points=1",),
    ("wheel.body.kind=condensed", "wheel.body.web={hub_outer_mm=300.0}"),
    ("wheel.body.kind=condensed",),
    ("pair.torque_pinion_Nm=-5.0",),
    ("pair.torque_pinion_Nm=0.0",),
    ("pair.modul_mm=2.0",),
    ("pari.module_mm=2.0",),
    ("pinion=3",),
    ("=3",),
    ("pair.module_mm",),
    ("pair.module_mm=",),
    ("pair.module_mm=nan",),
    ("pair.module_mm=1e400",),
    ("pair.module_mm=150.0",),
    ("material.young_GPa=206000.0",),
    ("robust.samples=100", 'robust.scatter={"pair.torque_pinion_Nm"=1.0}'),
    ('robust.scatter={"pair.torque"=1.0}',),
    ("flank.pinion.pitch_error_um=[1e9]",),
)

_WRONG = {
    "float": ("true", "-1e9", "1e12"),
    "int": ("1.5", "-7"),
    "text": ("3", '"no such choice"'),
    "bool": ("3",),
    "floats": ("3.0", '["a"]', "[-1e9, 1e12]"),
    "texts": ("3", "[4]"),
}


def error_texts() -> dict[str, object]:
    """What is said of every wrong scene, under what makes it wrong."""
    wanted = [*_TOGETHER]
    for path, key in KEYS.items():
        at = path.replace("[]", "[0]")
        wanted += [(f"{at}={value}",) for value in _WRONG[key.kind]]
        wanted.append((f"{at}x=1",))
    found: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        file.write_bytes((READY / "accessory.toml").read_bytes())
        for sets in wanted:
            try:
                read_scene(file, sets)
                found[" ".join(sets)] = "read"
            except SceneError as error:
                found[" ".join(sets)] = str(error).replace(str(file), "scene.toml").splitlines()
    return found
