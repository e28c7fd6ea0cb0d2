"""Reference and validation toolkit for the renderers of full-parallax spatial displays.

The public API on one page; each command of `xfrustum` is one of these:

    open_scene(name_or_path)                 a scene file or a built-in scene      -> Scene
    new_scene(mesh, path)                    writes a scene file that fits a mesh  -> NewScene
    check(scene)                             what lies where, and who sees it      -> SceneCheck
    Reference(scene).trace(aperture)         the ray-traced truth of an aperture   -> HogelImage
    DoubleFrustum(near=0.1)                  one way to draw the two cameras
    Rasterizer(scene).render(aperture, ..)   what OpenGL makes of it               -> HogelImage
    compare_images(truth, raster, reference) the error between them, per pixel     -> Comparison
    Evaluator(scene).stream(apertures, settings) several drawn, judged hogels     -> JudgedHogel, ..
    write_plate(scene, settings, folder)     many apertures, drawn as a stream      -> PlateFiles
    camera_of(plate, column, row)            the camera of a hogel of a stored plate -> HogelCamera
    make_report(scene, folder, ReportOptions(..))  a sweep over settings, as a page  -> ReportFiles
    budget(scene, settings)                  every wrong pixel charged to its cause -> BudgetReport
    plan(scene, apertures, Requirement())    the fewest slabs, and a near with a margin -> PlanReport
    cost(scene, tolerance_px=0.5)            error against time of every setting   -> CostReport
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

Names are imported when they are first used (`__init__.pyi`), so that `import xfrustum` costs nothing.
"""

import sys
from typing import Any

import lazy_loader

_lazy, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib import metadata  # noqa: PLC0415 - it costs more than all the rest

        return metadata.version("xfrustum")
    return _lazy(name)


def load_ipython_extension(shell: Any) -> None:
    """Make IPython display scenes, images and comparisons; `%load_ext xfrustum` calls it."""
    from xfrustum.reports.displays import register  # noqa: PLC0415 - for notebooks alone

    register(shell.display_formatter.formatters)


# A notebook displays objects without a further step of its user.
if (_shell := getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()) is not None:
    load_ipython_extension(_shell)
