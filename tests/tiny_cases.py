"""The smallest scene with a condensed body that vibrates, and the smallest study, for tests."""

from pathlib import Path

# Its last table is the wheel's.
TINY_PAIR = """schema = 1
name = "tiny"
[pair]
module_mm = 3.0
torque_pinion_Nm = 100.0
[pinion]
teeth = 20
face_width_mm = 12.0
[wheel]
teeth = 24
face_width_mm = 10.0
"""


def tiny_scene(modes: int, gear_at: float) -> str:
    """Head of a scene: a pair whose wheel has a thin web, on a shaft with two bearings.

    **Arguments:**

    - `modes`: of the wheel's body.
    - `gear_at`: place of the wheel on its shaft [mm].
    """
    return f"""{TINY_PAIR}[wheel.body]
kind = "condensed"
web = {{ hub_outer_mm = 30, web_thickness_mm = 3, rim_inner_mm = 56 }}
modes = {modes}
compare_seats = false
fineness = {{ sectors = 24, rim_across = 1, web_along = 1, hub_deep = 1 }}
[wheel.shaft]
gear_at_mm = {gear_at}
segments = [ {{ length_mm = 40, outer_mm = 20, inner_mm = 8 }} ]
bearings = [
    {{ at_mm = 0, radial_N_m = 1e8, axial_N_m = 5e7 }},
    {{ at_mm = 40, radial_N_m = 5e7 }},
]
"""


def small_study(
    folder: Path, work: str = "", *, points: int = 12, chunk: int = 2, arrays: str = ""
) -> Path:
    """A study of the accessory pair by relief and torque, of few phases, written into a folder.

    **Arguments:**

    - `folder`: where to.
    - `work`: more lines of its table [work].
    - `points`: designs.
    - `chunk`: designs in a chunk.
    - `arrays`: that are kept of each design, as TOML.
    """
    path = folder / "study.toml"
    path.write_text(
        f"""schema = 1
scene = "accessory"
set = ["mesh.phases=8", "mesh.slices=1"]
[design]
points = {points}
[design.between]
"flank.pinion.tip_relief.depth_um" = [0.0, 30.0]
"pair.torque_pinion_Nm" = [40.0, 120.0]
[keep]
numbers = ["static.te_rms_um", "static.max_pressure_MPa"]
arrays = [{arrays}]
gradients = true
[work]
chunk = {chunk}
{work}""",
        encoding="utf-8",
    )
    return path
