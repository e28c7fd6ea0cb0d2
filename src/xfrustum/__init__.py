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
    make_report(scene, folder, ReportOptions(..))  a sweep over settings, as a page  -> ReportFiles
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

_NAMES = {
    "scenes": "Aperture Camera Cull DepthFormat DepthMapping DoubleFrustum Fit "
    "HogelImage InputError Offset Pivot Scene open_scene",
    "reports.verification.baseline": "Baseline BaselineOptions baseline",
    "reports.budget": "BudgetReport budget",
    "reports.exchange.cameras": "CameraFiles write_cameras",
    "compare.metrics.comparison": "Comparison compare_images",
    "reports.exchange.convert": "Conversion ConversionOptions convert",
    "reports.cost.cost": "CostReport cost",
    "reports.explain": "EffectsPlan explain",
    "scenes.model.eye": "Eye",
    "compare.run": "Judge JudgedDrawing JudgedHogel",
    "reports.scene_check.new_scene": "NewScene new_scene",
    "compare.planning.plan": "Plan",
    "reports.plate.plate": "PlateFiles write_plate",
    "raster": "Rasterizer",
    "reference": "Reference",
    "reports.error_report.report": "ReportFiles make_report",
    "reports.error_report.settings": "ReportOptions",
    "compare.planning.views": "Requirement",
    "reports.scene_check.checking": "SceneCheck check",
    "reports.eye.view": "SceneView view",
    "reports.survey.answer": "Survey",
    "reports.verification.verdict": "Verification",
    "reports.plate.store": "camera_of",
    "reports.planning": "make_plan plan",
    "scenes.files.exr": "read_image write_image",
    "reports.survey.survey": "survey",
    "reports.verification.verification": "VerifyOptions verify",
}
"""Public names by the module that has them; type checkers read `__init__.pyi`."""

_CALLED = {"cost": "measure_cost", "plan": "make_plan"}
"""Names in these modules, where they are others."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted([*_MODULES, "__version__"])  # noqa: PLE0605 - a list, of what is above


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib import metadata  # noqa: PLC0415 - it costs more than all the rest

        return metadata.version("xfrustum")
    if name not in _MODULES:
        raise AttributeError(f"module 'xfrustum' has no attribute {name!r}")
    return getattr(import_module(f"xfrustum.{_MODULES[name]}"), _CALLED.get(name, name))


def __dir__() -> list[str]:
    return __all__
