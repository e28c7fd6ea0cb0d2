"""Reference and validation toolkit for the renderers of full-parallax spatial displays.

The public API on one page; each command of `xfrustum` is one of these:

    open_scene(name_or_path)                 a scene file or a built-in scene     -> Scene
    new_scene(mesh, path)                    writes a scene file that fits a mesh -> NewScene
    check(scene)                             place and visibility of objects      -> SceneCheck
    Reference(scene).trace(aperture)         ray-traced truth of an aperture      -> HogelImage
    DoubleFrustum(near=0.1)                  settings of the two cameras
    Rasterizer(scene).render(aperture, ..)   the same, drawn by OpenGL            -> HogelImage
    compare_images(truth, raster, reference) errors per pixel                     -> Comparison
    Evaluator(scene).stream(apertures, ..)   drawn and judged hogels              -> JudgedHogel, ..
    write_plate(scene, settings, folder)     many apertures, drawn as a stream    -> PlateFiles
    camera_of(plate, column, row)            camera of a hogel of a stored plate  -> HogelCamera
    make_report(scene, folder, ..)           a sweep over settings, as a page     -> ReportFiles
    budget(scene, settings)                  wrong pixels charged to causes       -> BudgetReport
    plan(scene, apertures, Requirement())    fewest slabs, and near with a margin -> PlanReport
    cost(scene, tolerance_px=0.5)            error against time of every setting  -> CostReport
    survey(scene, settings, folder)          error bound of a plate               -> Survey
    view(scene, [Eye(position=(0, 0, 600))]) views of eyes before a display       -> SceneView
    verify(scene, source)                    verdict on any renderer's hogels     -> Verification
    baseline(verification, folder)           regressions against accepted results -> Baseline
    convert(source, out, write_as="views")   plates in other layouts of files     -> Conversion
    write_cameras(scene, "json", folder, ..) cameras for other renderers          -> CameraFiles
    write_image(path, image)                 hogel image as OpenEXR; also read_image
    ExactIntersector(mesh).first(..)         first surfaces of any rays, exactly  -> FirstHits
    InputError                               mistake that the caller can fix

Modules that every layer may use:

    process      Ctrl-C and SIGTERM, messages on standard error, text made safe for a terminal
    tolerances   Default limits of pictures: the one place for these numbers

Names are imported on first use (`__init__.pyi`), so that `import xfrustum` costs nothing.
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


# Register displays in a notebook without an action of the user.
if (_shell := getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()) is not None:
    load_ipython_extension(_shell)
