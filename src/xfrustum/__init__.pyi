"""Public names with their types; `__init__.py` imports each when it is first used."""

from xfrustum.compare.metrics.comparison import Comparison as Comparison
from xfrustum.compare.metrics.comparison import compare_images as compare_images
from xfrustum.compare.planning.plan import Plan as Plan
from xfrustum.compare.planning.views import Requirement as Requirement
from xfrustum.compare.run import Judge as Judge
from xfrustum.compare.run import JudgedDrawing as JudgedDrawing
from xfrustum.compare.run import JudgedHogel as JudgedHogel
from xfrustum.raster import Rasterizer as Rasterizer
from xfrustum.reference import Reference as Reference
from xfrustum.reports.budget import BudgetReport as BudgetReport
from xfrustum.reports.budget import budget as budget
from xfrustum.reports.cost.cost import CostReport as CostReport
from xfrustum.reports.cost.cost import measure_cost
from xfrustum.reports.error_report.report import ReportFiles as ReportFiles
from xfrustum.reports.error_report.report import make_report as make_report
from xfrustum.reports.error_report.settings import ReportOptions as ReportOptions
from xfrustum.reports.exchange.cameras import CameraFiles as CameraFiles
from xfrustum.reports.exchange.cameras import write_cameras as write_cameras
from xfrustum.reports.exchange.convert import Conversion as Conversion
from xfrustum.reports.exchange.convert import ConversionOptions as ConversionOptions
from xfrustum.reports.exchange.convert import convert as convert
from xfrustum.reports.explain import EffectsPlan as EffectsPlan
from xfrustum.reports.explain import explain as explain
from xfrustum.reports.eye.view import SceneView as SceneView
from xfrustum.reports.eye.view import view as view
from xfrustum.reports.planning import make_plan as make_plan
from xfrustum.reports.plate.plate import PlateFiles as PlateFiles
from xfrustum.reports.plate.plate import write_plate as write_plate
from xfrustum.reports.plate.store import camera_of as camera_of
from xfrustum.reports.scene_check.checking import SceneCheck as SceneCheck
from xfrustum.reports.scene_check.checking import check as check
from xfrustum.reports.scene_check.new_scene import NewScene as NewScene
from xfrustum.reports.scene_check.new_scene import new_scene as new_scene
from xfrustum.reports.survey.answer import Survey as Survey
from xfrustum.reports.survey.survey import survey as survey
from xfrustum.reports.verification.baseline import Baseline as Baseline
from xfrustum.reports.verification.baseline import BaselineOptions as BaselineOptions
from xfrustum.reports.verification.baseline import baseline as baseline
from xfrustum.reports.verification.verdict import Verification as Verification
from xfrustum.reports.verification.verification import VerifyOptions as VerifyOptions
from xfrustum.reports.verification.verification import verify as verify
from xfrustum.scenes import Aperture as Aperture
from xfrustum.scenes import Camera as Camera
from xfrustum.scenes import Cull as Cull
from xfrustum.scenes import DepthFormat as DepthFormat
from xfrustum.scenes import DepthMapping as DepthMapping
from xfrustum.scenes import DoubleFrustum as DoubleFrustum
from xfrustum.scenes import Fit as Fit
from xfrustum.scenes import HogelImage as HogelImage
from xfrustum.scenes import InputError as InputError
from xfrustum.scenes import Offset as Offset
from xfrustum.scenes import Pivot as Pivot
from xfrustum.scenes import Scene as Scene
from xfrustum.scenes import open_scene as open_scene
from xfrustum.scenes.files.exr import read_image as read_image
from xfrustum.scenes.files.exr import write_image as write_image
from xfrustum.scenes.model.eye import Eye as Eye

__all__: list[str]
__version__: str
plan = make_plan
cost = measure_cost
