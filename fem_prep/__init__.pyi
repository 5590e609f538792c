"""The public names, in the order in which data flows."""

from ._checks import BodyError as BodyError
from ._checks import Progress as Progress

from ._grid import Grid as Grid
from ._grid import surface as surface
from ._grid import surface_of as surface_of

from ._web import Fineness as Fineness
from ._web import GearBody as GearBody
from ._web import Holes as Holes
from ._web import SeatPlace as SeatPlace
from ._web import Segment as Segment
from ._web import Web as Web
from ._web import body_grid as body_grid
from ._web import exact_properties as exact_properties
from ._web import symmetry as symmetry

from ._quality import check_grid as check_grid
from ._quality import quality as quality

from ._decks import files_of as files_of

from ._files import read_grid as read_grid
from ._files import write_vtu as write_vtu

from ._assembly import Material as Material
from ._assembly import assemble as assemble
from ._assembly import stress_stiffening as stress_stiffening
from ._assembly import surface_mass as surface_mass

from ._patch import CUT as CUT
from ._patch import RIM as RIM
from ._patch import piece_compliance as piece_compliance
from ._patch import piece_of as piece_of
from ._patch import refined as refined

from ._symmetry import Rotation as Rotation

from ._artefact import ReducedBody as ReducedBody
from ._artefact import balanced as balanced
from ._artefact import floating as floating
from ._artefact import rigid_motions as rigid_motions

from ._body_file import content_hash as content_hash
from ._body_file import read_body as read_body
from ._body_file import write_body as write_body

from ._cache import CacheWarning as CacheWarning
from ._cache import cache_entries as cache_entries
from ._cache import cache_folder as cache_folder
from ._cache import cached as cached
from ._cache import clear_cache as clear_cache
from ._cache import file_digest as file_digest
from ._cache import key_of as key_of

from ._boundary import FullBody as FullBody
from ._seats import Seat as Seat
from ._boundary import Teeth as Teeth
from ._boundary import full_body as full_body

from ._modes import free_modes as free_modes
from ._modes import largest_rotation as largest_rotation
from ._modes import reduced_modes as reduced_modes

from ._condense import Held as Held
from ._condense import condense as condense
from ._hold import hold as hold
from ._hold import recovered as recovered

from ._fourier import expected_split as expected_split
from ._fourier import families as families
from ._fourier import identify as identify
from ._fourier import symmetry_splitting as symmetry_splitting

from ._answers import Solid as Solid
from ._static_answers import Springs as Springs
from ._answers import described_modes as described_modes
from ._answers import modes_told as modes_told
from ._answers import rim_rows as rim_rows
from ._answers import solid_of as solid_of

from ._health import health_report as health_report

from ._imports import import_superelement as import_superelement
