"""Better flanks by gradient: objectives, searches within bounds, and the Master Curve.

Built on the public names of `jaxgear` alone.
"""

from optimise._baselines import cma_es as cma_es
from optimise._baselines import differential_evolution as differential_evolution
from optimise._dynamic_objectives import AbstractResponse as AbstractResponse
from optimise._dynamic_objectives import DynamicErrorVariance as DynamicErrorVariance
from optimise._dynamic_objectives import DynamicRatio as DynamicRatio
from optimise._dynamic_objectives import Judged as Judged
from optimise._dynamic_objectives import OverSpeeds as OverSpeeds
from optimise._dynamic_objectives import require_regular as require_regular
from optimise._master_curve import ReliefMap as ReliefMap
from optimise._master_curve import TracedCurve as TracedCurve
from optimise._master_curve import Valley as Valley
from optimise._master_curve import master_curve_depth as master_curve_depth
from optimise._master_curve import relief_map as relief_map
from optimise._master_curve import traced_curve as traced_curve
from optimise._objectives import AbstractObjective as AbstractObjective
from optimise._objectives import FaceLoadFactor as FaceLoadFactor
from optimise._objectives import LargestPressure as LargestPressure
from optimise._objectives import TransmissionErrorRange as TransmissionErrorRange
from optimise._objectives import TransmissionErrorRms as TransmissionErrorRms
from optimise._objectives import TransmissionErrorVariance as TransmissionErrorVariance
from optimise._objectives import WeightedSum as WeightedSum
from optimise._objectives import over_torques as over_torques
from optimise._objectives import prepare_torques as prepare_torques
from optimise._objectives import residuals_over_torques as residuals_over_torques
from optimise._objectives import responses_over_torques as responses_over_torques
from optimise._record import Box as Box
from optimise._record import Record as Record
from optimise._record import SearchResult as SearchResult
from optimise._record import Watcher as Watcher
from optimise._robust import AbstractMeasure as AbstractMeasure
from optimise._robust import Influence as Influence
from optimise._robust import Mean as Mean
from optimise._robust import Population as Population
from optimise._robust import Quantile as Quantile
from optimise._robust import Quantity as Quantity
from optimise._robust import influences as influences
from optimise._robust import measured as measured
from optimise._robust import moved_alone as moved_alone
from optimise._robust import over_samples as over_samples
from optimise._robust import population as population
from optimise._robust import ranked as ranked
from optimise._robust import responses_of as responses_of
from optimise._robust import scattered as scattered
from optimise._search import Limit as Limit
from optimise._search import adam as adam
from optimise._search import constrained as constrained
from optimise._search import lbfgs as lbfgs
from optimise._search import least_squares as least_squares
from optimise._strategies import annealed as annealed
from optimise._strategies import multi_start as multi_start
from optimise._strategies import sobol as sobol
