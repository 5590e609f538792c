"""Units at the door: multiply on the way in, divide on the way out. Inside, SI and radians."""

import math

mm = 1e-3
um = 1e-6
deg = math.pi / 180.0
rpm = 2.0 * math.pi / 60.0
# Of an unbalance, mass times its distance from the axis [kg m].
g_mm = 1e-6
MPa = 1e6
GPa = 1e9
# Stiffness of a tooth pair per length of contact line, as gear engineers quote it: N/(mm um).
N_per_mm_um = 1e9
