"""Gear dynamics that can be differentiated.

Names stand in the order in which data flows: units, geometry, flanks, contact, interface,
system, solve, dynamics, response, and the door to scene files. Everything inside is SI and radians;
JAX must be in double precision.
"""

from jaxgear._units import GPa as GPa
from jaxgear._units import MPa as MPa
from jaxgear._units import N_per_mm_um as N_per_mm_um
from jaxgear._units import deg as deg
from jaxgear._units import mm as mm
from jaxgear._units import rpm as rpm
from jaxgear._units import um as um

from jaxgear._smooth import smooth_maximum as smooth_maximum
from jaxgear._smooth import smooth_ramp as smooth_ramp

from jaxgear._geometry._gear import Gear as Gear
from jaxgear._geometry._gear import Material as Material
from jaxgear._geometry._involute import inverse_involute as inverse_involute
from jaxgear._geometry._involute import involute as involute
from jaxgear._geometry._lines import ContactLines as ContactLines
from jaxgear._geometry._lines import MeshGrid as MeshGrid
from jaxgear._geometry._lines import contact_lines as contact_lines
from jaxgear._geometry._lines import mean_line_length as mean_line_length
from jaxgear._geometry._lines import mesh_grid as mesh_grid
from jaxgear._geometry._pair import GearPair as GearPair
from jaxgear._geometry._pair import full_tip_shortening as full_tip_shortening
from jaxgear._geometry._pair import overlap_ratio as overlap_ratio
from jaxgear._geometry._pair import pair_facts as pair_facts
from jaxgear._geometry._pair import profile_contact_ratio as profile_contact_ratio
from jaxgear._geometry._pair import total_contact_ratio as total_contact_ratio
from jaxgear._geometry._tip_contact import tip_contact_rolls as tip_contact_rolls
from jaxgear._geometry._tip_contact import tip_separation as tip_separation
from jaxgear._geometry._profile import ToothSection as ToothSection
from jaxgear._geometry._profile import tooth_section as tooth_section

from jaxgear._flank._deviations import AbstractFlankDeviation as AbstractFlankDeviation
from jaxgear._flank._deviations import Bias as Bias
from jaxgear._flank._deviations import Crowning as Crowning
from jaxgear._flank._deviations import EllipticalCrowning as EllipticalCrowning
from jaxgear._flank._deviations import EndRelief as EndRelief
from jaxgear._flank._deviations import Flanks as Flanks
from jaxgear._flank._deviations import HelixSlope as HelixSlope
from jaxgear._flank._deviations import ProfileCrowning as ProfileCrowning
from jaxgear._flank._deviations import ProfileSlope as ProfileSlope
from jaxgear._flank._deviations import ProfileWaviness as ProfileWaviness
from jaxgear._flank._deviations import RootRelief as RootRelief
from jaxgear._flank._deviations import Superposed as Superposed
from jaxgear._flank._deviations import TipRelief as TipRelief
from jaxgear._flank._indexing import Indexing as Indexing
from jaxgear._flank._measured import MeasuredProfile as MeasuredProfile
from jaxgear._flank._measured import MeasuredTopography as MeasuredTopography
from jaxgear._flank._tolerances import FlankTolerances as FlankTolerances
from jaxgear._flank._tolerances import GradeWaveform as GradeWaveform
from jaxgear._flank._tolerances import deviation_of_grade as deviation_of_grade
from jaxgear._flank._tolerances import flank_tolerances as flank_tolerances
from jaxgear._flank._tolerances import pitch_error_of_grade as pitch_error_of_grade

from jaxgear._contact._cells import MeshCells as MeshCells
from jaxgear._contact._cells import Misalignment as Misalignment
from jaxgear._contact._cells import mesh_cells as mesh_cells
from jaxgear._contact._cells import mesh_gap as mesh_gap
from jaxgear._contact._cells import nominal_line_load as nominal_line_load
from jaxgear._contact._compliance import AbstractCompliance as AbstractCompliance
from jaxgear._contact._compliance import ConstantStiffness as ConstantStiffness
from jaxgear._contact._compliance import Iso6336 as Iso6336
from jaxgear._contact._compliance import IsoStiffness as IsoStiffness
from jaxgear._contact._compliance import WeberBanaschek as WeberBanaschek
from jaxgear._contact._compliance import hertz_contact as hertz_contact
from jaxgear._contact._compliance import iso_stiffness as iso_stiffness
from jaxgear._contact._compliance import single_pair_stiffness as single_pair_stiffness
from jaxgear._contact._compliance import SharedBody as SharedBody
from jaxgear._contact._foundation import AbstractFoundation as AbstractFoundation
from jaxgear._contact._foundation import NoFoundation as NoFoundation
from jaxgear._contact._foundation import RingFoundation as RingFoundation
from jaxgear._contact._foundation import SainsotFoundation as SainsotFoundation
from jaxgear._contact._foundation import WeberFoundation as WeberFoundation
from jaxgear._contact._tooth import HertzContact as HertzContact
from jaxgear._contact._tooth import beam_compliance as beam_compliance
from jaxgear._contact._tooth import penetration_compliance as penetration_compliance

from jaxgear._interface._laws import AbstractContactLaw as AbstractContactLaw
from jaxgear._interface._laws import ExactContact as ExactContact
from jaxgear._interface._laws import SmoothContact as SmoothContact
from jaxgear._interface._wrench import structure_vectors as structure_vectors

from jaxgear._system._model import PairModel as PairModel
from jaxgear._system._pair_system import PairSystem as PairSystem
from jaxgear._system._pair_system import pair_system as pair_system
from jaxgear._system._beam import Beam as Beam
from jaxgear._system._beam import beam_gyroscopic as beam_gyroscopic
from jaxgear._system._beam import beam_mass as beam_mass
from jaxgear._system._beam import beam_stiffness as beam_stiffness
from jaxgear._system._beam import cowper_coefficient as cowper_coefficient
from jaxgear._system._shaft import BeamBody as BeamBody
from jaxgear._system._shaft import Bearing as Bearing
from jaxgear._system._shaft import Segment as Segment
from jaxgear._system._shaft import Shaft as Shaft
from jaxgear._system._shaft import ShaftLoad as ShaftLoad
from jaxgear._system._structure import Housing as Housing
from jaxgear._system._structure import RigidBody as RigidBody
from jaxgear._system._structure import Structure as Structure
from jaxgear._system._structure import bearing_motion as bearing_motion
from jaxgear._system._structure import solid_disc as solid_disc
from jaxgear._system._support import Support as Support

from jaxgear._solve._contact import ContactProblem as ContactProblem
from jaxgear._solve._contact import ContactState as ContactState
from jaxgear._solve._contact import SolverSettings as SolverSettings
from jaxgear._solve._contact import contact_state as contact_state
from jaxgear._solve._cycle import MeshCycle as MeshCycle
from jaxgear._solve._cycle import PreparedMesh as PreparedMesh
from jaxgear._solve._cycle import corrected_cycle as corrected_cycle
from jaxgear._solve._cycle import mesh_cycle as mesh_cycle
from jaxgear._solve._cycle import prepare_mesh as prepare_mesh
from jaxgear._solve._cycle import quasi_static as quasi_static

from jaxgear._dynamics._damping import AbstractDamping as AbstractDamping
from jaxgear._dynamics._damping import ModalDamping as ModalDamping
from jaxgear._dynamics._damping import RayleighDamping as RayleighDamping
from jaxgear._dynamics._table import MeshTable as MeshTable
from jaxgear._dynamics._table import mesh_table as mesh_table
from jaxgear._dynamics._system import DynamicSystem as DynamicSystem
from jaxgear._dynamics._system import ModalBasis as ModalBasis
from jaxgear._dynamics._system import PairDynamics as PairDynamics
from jaxgear._dynamics._system import modal_basis as modal_basis
from jaxgear._dynamics._system import pair_dynamics as pair_dynamics
from jaxgear._dynamics._modes import Modes as Modes
from jaxgear._dynamics._modes import critical_speeds as critical_speeds
from jaxgear._dynamics._modes import modes as modes
from jaxgear._dynamics._modes import pair_modes as pair_modes
from jaxgear._dynamics._modes import rotating_frequencies as rotating_frequencies
from jaxgear._dynamics._orbit import AbstractMethod as AbstractMethod
from jaxgear._dynamics._orbit import Orbit as Orbit
from jaxgear._dynamics._orbit import contact_force as contact_force
from jaxgear._dynamics._steppers import AbstractStepper as AbstractStepper
from jaxgear._dynamics._steppers import Exponential as Exponential
from jaxgear._dynamics._steppers import GeneralizedAlpha as GeneralizedAlpha
from jaxgear._dynamics._steppers import HilberHughesTaylor as HilberHughesTaylor
from jaxgear._dynamics._steppers import Midpoint as Midpoint
from jaxgear._dynamics._steppers import Newmark as Newmark
from jaxgear._dynamics._march import History as History
from jaxgear._dynamics._march import Marching as Marching
from jaxgear._dynamics._march import at_rest as at_rest
from jaxgear._dynamics._march import march as march
from jaxgear._dynamics._march import quasi_static_start as quasi_static_start
from jaxgear._dynamics._transient import Profile as Profile
from jaxgear._dynamics._transient import Transient as Transient
from jaxgear._dynamics._transient import run_up as run_up
from jaxgear._dynamics._transient import start_stop as start_stop
from jaxgear._dynamics._transient import torque_step as torque_step
from jaxgear._dynamics._transient import transient as transient
from jaxgear._dynamics._harmonic import HarmonicBalance as HarmonicBalance
from jaxgear._dynamics._harmonic import balance_of as balance_of
from jaxgear._dynamics._harmonic import terms_of as terms_of
from jaxgear._dynamics._shooting import Shooting as Shooting
from jaxgear._dynamics._floquet import monodromy as monodromy
from jaxgear._dynamics._floquet import multipliers as multipliers
from jaxgear._dynamics._sweep import SweepPoint as SweepPoint
from jaxgear._dynamics._sweep import SweepSettings as SweepSettings
from jaxgear._dynamics._sweep import steady_state as steady_state
from jaxgear._dynamics._sweep import steady_states as steady_states
from jaxgear._dynamics._sweep import sweep as sweep
from jaxgear._dynamics._continuation import Curve as Curve
from jaxgear._dynamics._continuation import CurvePoint as CurvePoint
from jaxgear._dynamics._continuation import condition as condition
from jaxgear._dynamics._continuation import continuation as continuation
from jaxgear._dynamics._continuation import doubled as doubled
from jaxgear._dynamics._continuation import fold_gradient as fold_gradient
from jaxgear._dynamics._continuation import fold_near as fold_near

from jaxgear._response._dynamic import DynamicResponse as DynamicResponse
from jaxgear._response._dynamic import bearing_loads as bearing_loads
from jaxgear._response._dynamic import dynamic_ratio as dynamic_ratio
from jaxgear._response._dynamic import dynamic_response as dynamic_response
from jaxgear._response._dynamic import dynamic_transmission_error as dynamic_transmission_error
from jaxgear._response._dynamic import orbit_mean as orbit_mean
from jaxgear._response._dynamic import orbit_rms as orbit_rms
from jaxgear._response._dynamic import orbit_variance as orbit_variance
from jaxgear._response._dynamic import order_amplitudes as order_amplitudes
from jaxgear._response._dynamic import pair_forces as pair_forces
from jaxgear._response._dynamic import smooth_dynamic_ratio as smooth_dynamic_ratio
from jaxgear._response._energy import Energies as Energies
from jaxgear._response._energy import energies as energies
from jaxgear._response._factors import face_load as face_load
from jaxgear._response._factors import face_load_factor as face_load_factor
from jaxgear._response._factors import pressure_angle_change as pressure_angle_change
from jaxgear._response._factors import smooth_face_load_factor as smooth_face_load_factor
from jaxgear._response._factors import (
    smooth_transverse_load_factor as smooth_transverse_load_factor,
)
from jaxgear._response._factors import transverse_load_factor as transverse_load_factor
from jaxgear._response._factors import (
    working_pressure_angle_change as working_pressure_angle_change,
)
from jaxgear._response._loads import hertz_pressure as hertz_pressure
from jaxgear._response._loads import line_load as line_load
from jaxgear._response._loads import load_sharing as load_sharing
from jaxgear._response._loads import mesh_stiffness as mesh_stiffness
from jaxgear._response._transmission import cycle_mean as cycle_mean
from jaxgear._response._transmission import cycle_rms as cycle_rms
from jaxgear._response._transmission import cycle_variance as cycle_variance
from jaxgear._response._transmission import harmonic_amplitudes as harmonic_amplitudes
from jaxgear._response._transmission import peak_to_peak as peak_to_peak
from jaxgear._response._transmission import smooth_peak_to_peak as smooth_peak_to_peak
from jaxgear._response._transmission import transmission_error as transmission_error

from jaxgear._app._model import grid_of as grid_of
from jaxgear._app._model import law_of as law_of
from jaxgear._app._model import model_of as model_of
from jaxgear._app._scene import Scene as Scene
from jaxgear._app._scene import SceneError as SceneError
from jaxgear._app._scene import read_scene as read_scene
from jaxgear._app._scene import ready_scene as ready_scene
