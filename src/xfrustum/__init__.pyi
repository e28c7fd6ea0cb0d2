"""Public names with their types; `__init__.py` reads them and imports each on first use."""

from .compare.comparison import Comparison as Comparison
from .compare.comparison import compare_images as compare_images
from .compare.planning.requirement import Requirement as Requirement
from .compare.run import Evaluator as Evaluator
from .compare.run import JudgedDrawing as JudgedDrawing
from .compare.run import JudgedHogel as JudgedHogel
from .raster import Rasterizer as Rasterizer
from .rays import ExactIntersector as ExactIntersector
from .reference import Reference as Reference
from .reports.budget import BudgetReport as BudgetReport
from .reports.budget import budget as budget
from .reports.cost import CostReport as CostReport
from .reports.cost import cost as cost
from .reports.error_report.report import ReportFiles as ReportFiles
from .reports.error_report.report import make_report as make_report
from .reports.error_report.sweep import ReportOptions as ReportOptions
from .reports.exchange.cameras import CameraFiles as CameraFiles
from .reports.exchange.cameras import write_cameras as write_cameras
from .reports.exchange.convert import Conversion as Conversion
from .reports.exchange.convert import ConversionOptions as ConversionOptions
from .reports.exchange.convert import convert as convert
from .reports.planning import PlanReport as PlanReport
from .reports.planning import plan as plan
from .reports.plate.plate import PlateFiles as PlateFiles
from .reports.plate.plate import PlateOptions as PlateOptions
from .reports.plate.plate import write_plate as write_plate
from .reports.plate.store import camera_of as camera_of
from .reports.scene_check.checking import SceneCheck as SceneCheck
from .reports.scene_check.checking import check as check
from .reports.scene_check.new_scene import NewScene as NewScene
from .reports.scene_check.new_scene import NewSceneOptions as NewSceneOptions
from .reports.scene_check.new_scene import new_scene as new_scene
from .reports.survey import Survey as Survey
from .reports.survey import survey as survey
from .reports.verification.baseline import Baseline as Baseline
from .reports.verification.baseline import BaselineOptions as BaselineOptions
from .reports.verification.baseline import baseline as baseline
from .reports.verification.request import VerifyOptions as VerifyOptions
from .reports.verification.verdict import Verification as Verification
from .reports.verification.verification import verify as verify
from .reports.view import SceneView as SceneView
from .reports.view import view as view
from .scenes import Aperture as Aperture
from .scenes import Camera as Camera
from .scenes import Cull as Cull
from .scenes import DepthFormat as DepthFormat
from .scenes import DepthMapping as DepthMapping
from .scenes import DoubleFrustum as DoubleFrustum
from .scenes import Fit as Fit
from .scenes import HogelImage as HogelImage
from .scenes import InputError as InputError
from .scenes import Offset as Offset
from .scenes import Pivot as Pivot
from .scenes import Scene as Scene
from .scenes import open_scene as open_scene
from .scenes.files.exr import read_image as read_image
from .scenes.files.exr import write_image as write_image
from .scenes.model.eye import Eye as Eye

__all__: list[str]
__version__: str

def load_ipython_extension(shell: object) -> None: ...
