"""`study`, `bench`, `selfcheck`, `device`: maps, speed, truth against brute force, rounding."""

from pathlib import Path
from typing import Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import COUNT_FROM_1, FOLDER, INDEX, POSITIVE, Measured, flag, option


@click.group(
    no_args_is_help=False, epilog="\b\nExample:\n  xfrustum study splitting --quick --out splitting"
)
def study() -> None:
    """Measure many scenes and settings, and map the results."""


class _Study(options.Measured):
    out = option(FOLDER, "Folder for the results.  [default: study/NAME]")
    quick = flag("Measure a small part, in less than a minute.")
    engine = options.engine_options("this process")

    def made(self, own: Any) -> None:
        """Run the study of a module, and print its results."""
        from xfrustum.reports.blocks import HERE

        out, engine = self.out or own.DEFAULT_FOLDER, self.engine or HERE
        files = own.make_study(
            out, own.QUICK if self.quick else own.FULL, engine, progress=self.progress
        )
        # Other parts of the job array are not finished yet.
        if files is None:
            options.note("this part is measured; the last part to be finished writes the study")
        else:
            self.tell(
                lambda: own.record(files), lambda: f"{own.sentence(files.rows)}\n{files.document}"
            )


@options.command("xfrustum study splitting --quick --out splitting", study)
def splitting(request: _Study) -> None:
    """Map where one pair of frusta is enough; write when-to-split.md, its figures and its data.

    A stopped run continues: measured pictures are kept.
    """
    from xfrustum.research import splitting as own

    request.made(own)


@options.command("xfrustum study noticeable --quick --out noticeable", study)
def noticeable(request: _Study) -> None:
    """Predict visible effects of near and depth buffer; write noticeable.md and its data.

    All settings are predicted in closed form, and some are checked by pictures for two eyes. A
    stopped run continues: checked viewing positions are kept.
    """
    from xfrustum.research import noticeable as own

    request.made(own)


@options.command("xfrustum study ways --quick --out ways", study)
def ways(request: _Study) -> None:
    """Measure plates by two cameras, slabs and directions; write ways.md, a figure and its data.

    A stopped run continues: measured plates are kept.
    """
    from xfrustum.research import ways as own

    request.made(own)


class _Figure7(options.Asked):
    scene: str = options.argument(default="car-studio")
    aperture = options.aperture_option
    other = option(
        INDEX, "Aperture of the second perspective of C*.  [default: the aperture that shows most]"
    )
    near = option(POSITIVE, "Near offset of both cameras.  [default: 1e-6 of the reach]")
    out = option(FOLDER, "Folder for the page.  [default: figure7/NAME]")


@options.command("xfrustum study figure7 car --out figure7", study)
def figure7(request: _Figure7) -> None:
    """Draw C alone, two perspectives of C*, and both cameras (the paper's figure 7); write a page.

    C* is shown as its camera draws it, looking back at the viewer, and as the overlay on C.
    """
    opened = options.open_scene(request.scene)
    chosen = options.chosen_aperture(opened, request.aperture)
    second = None if request.other is None else opened.plate.aperture(*request.other)
    from xfrustum.reports.error_report.report import default_folder
    from xfrustum.research import paper as figures

    folder = request.out or Path("figure7") / default_folder(opened).name
    options.check_out(folder, figures.FILES)
    options.look_at(opened, [chosen])
    # The default near is tiny: the figure shows geometry, not errors.
    settings = figures.default_settings(opened, request.near)
    figures.write_figure(opened, chosen, settings, second, folder)
    options.echo(str(folder / "index.html"))


@click.group(
    no_args_is_help=False,
    epilog="\b\nExample:\n  xfrustum bench plate asymmetric --resolution 64 --repeat 1",
)
def bench() -> None:
    """Measure speed on this machine."""


def _repeat(count: int) -> Any:
    return option(COUNT_FROM_1, "Number of timed runs, after a warm-up.", default=count)


def _measured(request: Measured, name: str, *what: Any, **settings: Any) -> None:
    """Run a benchmark and print its results."""
    from xfrustum.research import benchmarks, paper, ray_rates

    # Table 1 and rays have modules of their own; all other benchmarks share a module.
    own = {"table1": paper, "rays": ray_rates}.get(name, benchmarks)
    settings = options.present(**settings, progress=request.progress)
    result = getattr(own, f"benchmark_{name}")(*what, **settings)
    request.tell(lambda: result, lambda: getattr(own, f"{name}_table")(result))


class _Truth(Measured):
    scene = options.argument(default="car")
    resolution = option(options.SIZES, "Widths of square images, pixels.  [default: 512,1024,2048]")
    repeat = _repeat(9)


@options.command("xfrustum bench truth asymmetric --resolution 128 --repeat 1", bench)
def truth(request: _Truth) -> None:
    """Measure the certified truth against bare tracers, in million pixels per second."""
    scene = options.open_scene(request.scene)
    _measured(request, "truth", scene, resolutions=request.resolution, repeat=request.repeat)


class _Judge(Measured):
    scenes = options.argument(metavar="[SCENE]...", nargs=-1)
    resolution = option(
        options.SIZES, "Widths of square images, pixels.  [default: 128,256,512,1024]"
    )
    triangles = option(COUNT_FROM_1, "Add the car, subdivided into about N triangles.")
    hogels = option(COUNT_FROM_1, "Number of hogels judged in each run.", default=6)
    repeat = _repeat(5)


@options.command("xfrustum bench judge asymmetric --resolution 64 --hogels 2 --repeat 1", bench)
def judge(request: _Judge) -> None:
    """Measure judged hogels per second against plain loops and bare renderers.

    Without SCENE: the built-in car, ../shared/scenes/beetle.toml if it exists beside the checkout,
    and the car with a million triangles.
    """
    opened = [options.open_scene(name) for name in request.scenes]
    from xfrustum.research import benchmarks, paper

    # Scenes of the user replace the default set, including the tessellated car.
    count = request.triangles or (None if opened else 1_000_000)
    opened = opened or [options.open_scene(name) for name in benchmarks.default_scenes()]
    opened += [] if count is None else [paper.tessellated_car(count, 0.0).scene]
    _measured(
        request,
        "judge",
        opened,
        resolutions=request.resolution,
        hogels=request.hogels,
        repeat=request.repeat,
    )


class _BenchPlate(Measured):
    scene = options.argument(default="car")
    resolution = option(COUNT_FROM_1, "W = H.", default=128)
    repeat = _repeat(5)


@options.command("xfrustum bench plate asymmetric --resolution 64 --repeat 1", bench)
def plate(request: _BenchPlate) -> None:
    """Measure one row of a plate, drawn many hogels at once, against plain loops."""
    _measured(
        request, "plate", options.open_scene(request.scene), request.resolution, request.repeat
    )


class _Table1(Measured):
    resolution = option(COUNT_FROM_1, "W = H.", default=512)
    repeat = _repeat(5)


@options.command("xfrustum bench table1 --resolution 128 --repeat 1", bench)
def table1(request: _Table1) -> None:
    """Measure table 1 of the paper on the project's own car."""
    _measured(request, "table1", request.resolution, request.repeat)


class _Rays(Measured):
    mesh: Path | None = options.argument(metavar="[MESH]", required=False, type=FOLDER)
    rays = option(COUNT_FROM_1, "Number of rays in each run.", default=1_000_000)
    repeat = _repeat(5)


@options.command("xfrustum bench rays --rays 1000 --repeat 1", bench)
def rays(request: _Rays) -> None:
    """Measure exact rays of a mesh against trimesh's two classes and bare Embree.

    Without MESH: a sphere, the car, and ../shared/data/stanford-bunny.obj if it exists beside the
    checkout.
    """
    from xfrustum.research import ray_rates

    meshes = (
        ray_rates.default_meshes()
        if request.mesh is None
        else {request.mesh.stem: ray_rates.read_mesh(request.mesh)}
    )
    _measured(request, "rays", meshes, rays=request.rays, repeat=request.repeat)


class _Selfcheck(options.Measured):
    scenes: tuple[str, ...] = options.argument(metavar="[SCENE]...", nargs=-1)
    quick = flag("Check fewer scenes and pixels, in less than a minute.")


@options.command("xfrustum selfcheck asymmetric --quick")
def selfcheck(request: _Selfcheck) -> int:
    """Compare the truth with integer brute force; exit status 1 if a pixel differs.

    Without SCENE: all built-in scenes, all hard cases except the giants, a sphere with lines
    through all vertices and edges, and the scene files in the folder of test data beside the
    checkout.
    """
    from xfrustum.scenes.library.builtin import check_scene

    for name in request.scenes:
        # Test all names before checks that take minutes.
        check_scene(name)
    from xfrustum.compare import selfcheck as checking
    from xfrustum.reports.text import selfcheck_table

    result = checking.selfcheck(request.scenes, quick=request.quick, progress=request.progress)
    request.tell(result.summary, lambda: selfcheck_table(result))
    return 0 if result.agrees else options.LIMIT_EXCEEDED


class _Device(options.Measured):
    listed = flag("List the EGL devices instead of measuring.", "--list")
    out = option(FOLDER, "Folder for the page and device.json.")
    replay = option(FOLDER, "Explain recorded frames (.npz) instead of measuring.")
    device = options.device_option


@options.command("xfrustum device --out measured")
def device(request: _Device) -> int:
    """Measure how the OpenGL device rounds: snapping, depth, varyings, texture filter.

    The measurement takes seconds: it draws adversarial triangles of every size, writes depths, and
    filters a texture. Pass the written device.json as --device to `budget`, `report` or `verify`
    for images of that device. With --replay, explain recorded frames by the model of the device
    that drew them; exit status 1 if pixels stay unexplained.
    """
    from xfrustum.reports import device as measuring

    options.check_out(request.out, measuring.FILES)
    if request.replay is not None:
        replayed = measuring.replayed(request.replay, request.device, progress=request.progress)
        request.tell(lambda: replayed, lambda: measuring.replay_table(replayed))
        # An unexplained pixel refutes the model of the device.
        return options.LIMIT_EXCEEDED if replayed.unexplained else 0
    # Listing opens contexts but draws nothing.
    if request.listed:
        result = measuring.listed()
        request.tell(lambda: result, lambda: measuring.list_table(result))
        return 0
    measured = measuring.measure_device()
    if request.out is not None:
        measuring.write_device(measured, request.out)
    request.tell(lambda: measured, lambda: measuring.table(measured))
    return 0
