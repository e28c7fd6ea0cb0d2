"""Reference and validation toolkit for the renderers of full-parallax spatial displays.

The public API on one page; each command of `xfrustum` is one of these:

    open_scene(name_or_path)                 a scene file or a built-in scene      -> Scene
    new_scene(mesh, path)                    writes a scene file that fits a mesh  -> NewScene
    check(scene)                             what lies where, and who sees it      -> SceneCheck
    Reference(scene).trace(aperture)         the ray-traced truth of an aperture   -> HogelImage
    DoubleFrustum(near=0.1)                  one way to draw the two cameras
    Rasterizer(scene).render(aperture, ..)   what OpenGL makes of it               -> HogelImage
    compare_images(truth, raster, reference) the error between them, per pixel     -> Comparison
    Judge(scene).stream(apertures, settings) many hogels, drawn and judged         -> JudgedHogel, ..
    write_plate(scene, settings, folder)     many apertures, drawn as a stream      -> PlateFiles
    camera_of(plate, column, row)            the camera of a hogel of a stored plate -> HogelCamera
    make_report(scene, folder)               a sweep over settings, as a page      -> ReportFiles
    budget(scene, settings)                  every wrong pixel charged to its cause -> BudgetReport
    plan(scene, apertures, Requirement())    the fewest slabs, and a near with a margin    -> Plan
    cost(scene, tolerance_px=0.5)            error against time of every setting   -> CostReport
    explain(scene)                           what a scene calls for, and its cost  -> EffectsPlan
    survey(scene, settings, folder)          hogels judged all over a plate: a bound       -> Survey
    view(scene, [Eye(position=(0, 0, 600))]) what eyes see: scene, display, renderer  -> SceneView
    verify(scene, source)                    any renderer's hogels: a verdict, and why    -> Verification
    baseline(verification, folder)           what got worse than what was accepted         -> Baseline
    convert(source, out, write_as="views")   plates in other layouts of files           -> Conversion
    write_cameras(scene, "json", folder, ..) cameras for other renderers            -> CameraFiles
    write_image(path, image), read_image(path)   hogel images as OpenEXR
    InputError                               what the caller can fix

Modules that every layer may use:

    interrupts   Ctrl-C and SIGTERM: an exception in the main thread, and exit status 130 or 143
    terminal     The program's messages on standard error, and text from outside made fit for a terminal
    tolerances   Limits that pictures are held to where nobody states others: the one place for these numbers

Names are imported when they are first used, so that `import xfrustum` costs nothing.
"""

from __future__ import annotations

from importlib import import_module

# Type checkers know this name. Importing `typing` would take longer than all the rest of this module, and
# before `__main__` is reached no handler answers a signal.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from xfrustum.compare import Comparison, compare_images
    from xfrustum.compare.planning.plan import Plan
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.run import Judge, JudgedDrawing, JudgedHogel
    from xfrustum.raster import Rasterizer
    from xfrustum.reference import Reference
    from xfrustum.reports.commands.budgeting import BudgetReport, budget
    from xfrustum.reports.commands.planning import make_plan
    from xfrustum.reports.commands.planning import make_plan as plan
    from xfrustum.reports.cost.cost import CostReport
    from xfrustum.reports.cost.cost import measure_cost as cost
    from xfrustum.reports.effects.plan import EffectsPlan, explain
    from xfrustum.reports.error_report.report import ReportFiles, make_report
    from xfrustum.reports.exchange.camera_files import CameraFiles, write_cameras
    from xfrustum.reports.exchange.convert import Conversion, ConversionOptions, convert
    from xfrustum.reports.eye.viewing import SceneView, view
    from xfrustum.reports.plate.camera import camera_of
    from xfrustum.reports.plate.plate import PlateFiles, write_plate
    from xfrustum.reports.scene_check.checking import SceneCheck, check
    from xfrustum.reports.scene_check.new_scene import NewScene, new_scene
    from xfrustum.reports.survey.answer import Survey
    from xfrustum.reports.survey.survey import survey
    from xfrustum.reports.verification.baseline import Baseline, BaselineOptions, baseline
    from xfrustum.reports.verification.verdict import Verification
    from xfrustum.reports.verification.verification import verify
    from xfrustum.scenes import (
        Aperture,
        Camera,
        Cull,
        DepthFormat,
        DepthMapping,
        DoubleFrustum,
        Fit,
        HogelImage,
        InputError,
        Offset,
        Pivot,
        Scene,
        open_scene,
    )
    from xfrustum.scenes.files.openexr.images import read_image, write_image
    from xfrustum.scenes.model.eye import Eye

__all__ = [
    "Aperture",
    "Baseline",
    "BaselineOptions",
    "BudgetReport",
    "Camera",
    "CameraFiles",
    "Comparison",
    "Conversion",
    "ConversionOptions",
    "CostReport",
    "Cull",
    "DepthFormat",
    "DepthMapping",
    "DoubleFrustum",
    "EffectsPlan",
    "Eye",
    "Fit",
    "HogelImage",
    "InputError",
    "Judge",
    "JudgedDrawing",
    "JudgedHogel",
    "NewScene",
    "Offset",
    "Pivot",
    "Plan",
    "PlateFiles",
    "Rasterizer",
    "Reference",
    "ReportFiles",
    "Requirement",
    "Scene",
    "SceneCheck",
    "SceneView",
    "Survey",
    "Verification",
    "__version__",
    "baseline",
    "budget",
    "camera_of",
    "check",
    "compare_images",
    "convert",
    "cost",
    "explain",
    "make_plan",
    "make_report",
    "new_scene",
    "open_scene",
    "plan",
    "read_image",
    "survey",
    "verify",
    "view",
    "write_cameras",
    "write_image",
    "write_plate",
]

_MODULES = {  # module and, after a colon, the name in that module where it is another
    "Comparison": "compare",
    "compare_images": "compare",
    "Baseline": "reports.verification.baseline",
    "BaselineOptions": "reports.verification.baseline",
    "baseline": "reports.verification.baseline",
    "BudgetReport": "reports.commands.budgeting",
    "budget": "reports.commands.budgeting",
    "CostReport": "reports.cost.cost",
    "cost": "reports.cost.cost:measure_cost",
    "EffectsPlan": "reports.effects.plan",
    "explain": "reports.effects.plan",
    "Judge": "compare.run",
    "JudgedDrawing": "compare.run",
    "JudgedHogel": "compare.run",
    "Plan": "compare.planning.plan",
    "Requirement": "compare.planning.views",
    "make_plan": "reports.commands.planning",
    "plan": "reports.commands.planning:make_plan",
    "Rasterizer": "raster",
    "Reference": "reference",
    "Eye": "scenes.model.eye",
    "SceneView": "reports.eye.viewing",
    "view": "reports.eye.viewing",
    "ReportFiles": "reports.error_report.report",
    "make_report": "reports.error_report.report",
    "SceneCheck": "reports.scene_check.checking",
    "check": "reports.scene_check.checking",
    "NewScene": "reports.scene_check.new_scene",
    "new_scene": "reports.scene_check.new_scene",
    "Survey": "reports.survey.answer",
    "survey": "reports.survey.survey",
    "Verification": "reports.verification.verdict",
    "verify": "reports.verification.verification",
    "Conversion": "reports.exchange.convert",
    "ConversionOptions": "reports.exchange.convert",
    "convert": "reports.exchange.convert",
    "CameraFiles": "reports.exchange.camera_files",
    "write_cameras": "reports.exchange.camera_files",
    "read_image": "scenes.files.openexr.images",
    "write_image": "scenes.files.openexr.images",
    "camera_of": "reports.plate.camera",
    "PlateFiles": "reports.plate.plate",
    "write_plate": "reports.plate.plate",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib import metadata  # noqa: PLC0415 - it costs more than all the rest

        return metadata.version("xfrustum")
    if name not in __all__:
        raise AttributeError(f"module 'xfrustum' has no attribute {name!r}")
    module, _, other_name = _MODULES.get(name, "scenes").partition(":")
    return getattr(import_module(f"xfrustum.{module}"), other_name or name)


def __dir__() -> list[str]:
    return sorted(__all__)
