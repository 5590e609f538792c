"""Array aliases of the dynamics, with the axes that only they have.

| axis | meaning |
|---|---|
| `edge` | ends of the time steps of a cycle |
| `step` | time step within a cycle |
| `kept` | cell that may be in contact |
| `place` | start, middle and end of a time step |
| `dof` | degree of freedom that can move |
| `free` | motion that nothing holds |
| `mode` | natural mode, all of them or the first |
| `state` | part of a mode's state: displacement, velocity, acceleration where it is carried |
| `between` | lines, lines and slices that share a body, or cells and cells |
| `column` | column of a matrix of states |
| `speed` | operating speed |
| `order` | multiple of the mesh frequency |
| `term` | mean, then cosines, then sines of the harmonics |
"""

from typing import TYPE_CHECKING

from jaxtyping import Array, Complex, Float, Int

if TYPE_CHECKING:
    Edges = Array
    StepCells = Array
    KeptCells = Array
    Count = Array
    PlaceCells = Array
    PlaceArms = Array
    StepCoupling = Array
    StepPlaces = Array
    StepMatrices = Array
    Matrix = Array
    Vectors = Array
    Vector = Array
    FreeMotions = Array
    ModeValues = Array
    ModeMatrix = Array
    ModeVectors = Array
    States = Array
    Motion = Array
    Start = Array
    Speeds = Array
    Receptances = Array
    Responses = Array
    Waves = Array
    Poles = Array
    Terms = Array
    Basis = Array
    Analysis = Array
    PeriodValues = Array
    PeriodAnalysis = Array
    HarmonicMatrices = Array
    Series = Array
    PairSeries = Array
    BearingSeries = Array
    Orders = Array
    BearingOrders = Array
    BearingLoads = Array
else:
    Edges = Float[Array, "edge"]
    StepCells = Float[Array, "step cell"]
    KeptCells = Int[Array, "step kept"]
    Count = Int[Array, ""]
    PlaceCells = Float[Array, "place step cell"]
    PlaceArms = Float[Array, "place step cell coordinate"]
    StepCoupling = Float[Array, "step *between"]
    StepPlaces = Float[Array, "step coordinate"]
    StepMatrices = Float[Array, "step coordinate coordinate"]
    Matrix = Float[Array, "dof dof"]
    Vectors = Float[Array, "dof coordinate"]
    Vector = Float[Array, "dof"]
    FreeMotions = Float[Array, "dof free"]
    ModeValues = Float[Array, "mode"]
    ModeMatrix = Float[Array, "dof mode"]
    ModeVectors = Float[Array, "mode coordinate"]
    States = Float[Array, "state mode"]
    Motion = Float[Array, "step dof"]
    Start = Float[Array, "2 dof"]
    Speeds = Float[Array, "speed"]
    Receptances = Complex[Array, "harmonic coordinate coordinate"]
    Responses = Complex[Array, "harmonic dof coordinate"]
    Waves = Complex[Array, "..."]
    Poles = Complex[Array, "pole"]
    Terms = Float[Array, "coordinate term"]
    Basis = Float[Array, "step term"]
    Analysis = Float[Array, "term step"]
    PeriodValues = Complex[Array, "remainder place multiple"]
    PeriodAnalysis = Complex[Array, "remainder multiple place"]
    HarmonicMatrices = Float[Array, "harmonic coordinate coordinate"]
    Series = Float[Array, "step"]
    PairSeries = Float[Array, "step line"]
    BearingSeries = Float[Array, "step bearing 5"]
    Orders = Float[Array, "order"]
    BearingOrders = Float[Array, "order bearing 5"]
    BearingLoads = Float[Array, "bearing 5"]
