"""`verify`, `camera`, `convert`, `conformance`: other renderers.

Renderers are judged on a scene of the user, or on a frozen suite of cases, whose result is a
statement to cite. Cameras and layouts of plates are written for them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, POSITIVE, TEXT, choice, flag, group, option, several
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
    from xfrustum.reports.conformance import CaseRenderer
    from xfrustum.reports.exchange.convert import Conversion
    from xfrustum.reports.verification.verdict import Verification
    from xfrustum.scenes.conformance_suite import Case
    from xfrustum.scenes.model.scene import Scene


_COUNTS = options.Read(
    "COLUMNS,ROWS",
    # Quilts write 8x6 in file names, and users copy it.
    lambda text: options.RESOLUTION.read(text.replace("x", ",")),
    "COLUMNS,ROWS such as 8,6",
)


class _Convert(options.Measured):
    source: Path = options.argument(metavar="IN", type=options.FOLDER)
    out: Path = options.argument(type=options.FOLDER)
    read_as = option(options.LAYOUT_OR_ZARR, "Layout of IN.  [default: detected]", "--from")
    write_as = option(
        options.LAYOUT_OR_ZARR, "Layout of OUT.  [default: zarr for NAME.zarr]", "--to"
    )
    facts = several(
        hogels=option(_COUNTS, "Columns and rows of hogels; needed for a mosaic."),
        tiles=option(
            _COUNTS, "Columns and rows of tiles of a quilt.  [default: by the number of views]"
        ),
        suffix=choice(
            ".png .exr", "Format of the written pictures.  [default: .png; .exr for floats]"
        ),
        array=choice("color triangle", "Array of the Zarr group.  [default: color]"),
    )


@options.command("xfrustum convert plate.zarr plate.png --to mosaic")
def convert(request: _Convert) -> None:
    """Copy a plate into another layout of files, or from or to Zarr.

    IN and OUT are a folder of pictures, one picture, or a Zarr group. Pixels are copied without
    filtering; standard error lists data that the layout cannot store.
    """
    from xfrustum.reports.exchange import convert as converting

    layouts = request.read_as, request.write_as
    facts = converting.ConversionOptions(**request.facts)
    done = converting.convert(
        request.source, request.out, *layouts, facts, progress=request.progress
    )
    tell_losses(done)
    (columns, rows), (width, height) = done.hogels, done.resolution
    counted = f"{columns} x {rows} hogels of {width} x {height} pixels in {done.files} files"
    read = f"read as {done.read_as}: {'; '.join(done.reasons)}"
    request.tell(lambda: done, lambda: f"{read}\n{counted} ({done.written_as})\n{done.out}")


def tell_losses(done: Conversion) -> None:
    """Print on standard error the data that a layout cannot store, and notes for its readers."""
    for line in (*(f"lost: {lost}" for lost in done.losses), *done.notes):
        options.note(line)


def _tolerance(text: str) -> Any:
    from xfrustum.reports.verification.baseline import Stated

    return Stated.from_text(text)


def _baseline(baseline: Path | None, **request: Any) -> dict[str, Any] | None:
    """Return the options of a baseline, its folder included; None without a baseline."""
    if baseline is not None:
        return {"folder": baseline, **request}
    # Options of a baseline without its folder would have no effect.
    for name in filter(options.is_given, request):
        raise click.UsageError(f"{options.flag_of(name)} is about --baseline DIR: give it too")
    return None


_TOLERANCE = options.Read(
    "SHARE|NAME=AMOUNT,..", _tolerance, "a tolerance such as 5% or wrong_surfaces=3"
)
_PIXELS = options.Read(
    # An undefined displacement exceeds every number, even infinity; only the value `none` accepts
    # it.
    "PX|none",
    lambda n: float(n) if n != "none" else None,
    "a number of pixels or none",
)


class _Verify(options.Measured):
    scene = options.scene_argument
    source: str | None = options.argument(required=False)
    judged = several(
        command=option(
            options.TEXT,
            "Program to run for each aperture: 'my-renderer --x {x} --y {y} --out {out}'.",
        ),
        encoding=options.encoding_option,
        layout=option(options.LAYOUT, "Layout of SOURCE.  [default: detected]"),
        apertures=option(
            options.BLOCKS, "Columns,rows, such as 20,20;0-80,3.  [default: the whole plate]"
        ),
        sample=option(options.COUNT_FROM_1, "Number of random hogels to judge."),
        until=option(
            options.SHARE,
            "Judge random hogels until at most this share, such as 1%, fails (95 % confidence).",
        ),
        seed=options.seed_option,
        truth_by=options.truth_option,
        near=option(
            click.FLOAT, "Near offset of the renderer, if the offset is intended.  [default: 0]"
        ),
        accept=option(
            options.ACCEPTED,
            "Conventions that are not defects, such as orientation,order; or all.",
            default=(),
        ),
        compare=choice(
            "color geometry",
            "Judge plain pictures by colors, or by outlines (geometry).",
            default="color",
        ),
        max_wrong=option(
            options.SHARE,
            "Largest share of wrong surfaces (colors, outlines) in the pixels that show something.",
            default="1%",
        ),
        max_displacement_px=option(
            _PIXELS,
            "Largest displacement of 99 % of points or outlines, pixels; none: no limit.",
            default=str(TOLERANCE_PX),
        ),
        max_color=option(
            click.FLOAT,
            "Largest difference of a right color, linear.  [default: 0.009, rounding to 8 bits]",
        ),
        timeout_s=option(
            options.POSITIVE,
            "Time limit of one run of the program, seconds.",
            "--timeout",
            default=60.0,
        ),
    )
    model = options.device_option
    engine = options.engine_options("this process", draws=False)
    out = option(options.FOLDER, "Folder for index.html, inspect.html, verification.json.")
    junit = option(options.FOLDER, "JUnit XML file for continuous integration.")
    baseline = group(
        _baseline,
        baseline=option(options.FOLDER, "Folder of accepted measures: fail if a measure is worse."),
        approve=flag("Store the present measures as accepted in --baseline."),
        tolerance=option(
            _TOLERANCE,
            "Allowed increase of measures, such as 5% or wrong_surfaces=3.  [default: none]",
            "--baseline-tolerance",
        ),
        renderer=option(
            options.TEXT,
            "Name of the renderer in --baseline.  [default: SOURCE or the command]",
        ),
        device=option(
            options.TEXT,
            "Name of the renderer's device in --baseline.  [default: this machine's processor]",
            "--baseline-device",
        ),
    )

    def verified(self, scene: Scene) -> Verification | None:
        """Judge in this process or in workers; return None while other parts are not finished."""
        from xfrustum.reports.verification.jobs import verify_on
        from xfrustum.reports.verification.request import VerifyOptions
        from xfrustum.reports.verification.verification import verify

        how = {"channels": self.out is not None, "progress": self.progress, "device": self.model}
        apertures = options.indices_of(scene, self.judged["apertures"])
        # Sequential sampling chooses the size of the sample, so a fixed size contradicts it.
        if self.judged["sample"] is not None and self.judged["until"] is not None:
            raise click.UsageError("--sample and --until exclude each other: give one of them")
        values: dict[str, Any] = {**self.judged, **how, "apertures": apertures}
        judged = VerifyOptions(**values)
        if self.engine is None:
            return verify(scene, self.source, judged)
        if judged.layout is not None:
            raise click.UsageError("--layout is for this process: leave out --workers and the like")
        if judged.truth_by == "directions":
            raise click.UsageError(
                "--truth-by directions is for this process: leave out --workers and the like"
            )
        return verify_on(self.engine, scene, self.source, judged, self.out, options.note)


@options.command(
    "xfrustum verify asymmetric --apertures '20,20;60,40' --command 'xfrustum raster asymmetric "
    "--near 0.001 --depth d32f --mapping reversed --aperture {i},{j} --out {out}'"
)
def verify(request: _Verify) -> int:
    """Judge the hogel images of any renderer, and name its defects.

    SOURCE is a pattern of files, {i} the column and {j} the row: 'DIR/hogel_{i}x{j}.png'; or a
    folder or a picture in one of the layouts (docs/layouts.md), or a Zarr group. --sample and
    --until bound the share of the plate's hogels that fail, and write hogels.parquet. Exit status 1
    if a hogel is missing or exceeds a limit, or if the bound exceeds --until. With accepted
    measures in --baseline, exit status 1 if a measure is worse, or a limit given as an option is
    exceeded.
    """
    opened = options.open_scene(request.scene)
    from xfrustum.reports.common.outputs import check_writable_file
    from xfrustum.reports.verification.verdict import FILES, table, write_junit, write_verification

    if request.junit is not None:
        # Fail now if the file cannot be written, not after hours of judging.
        check_writable_file(request.junit, "--junit")
    options.check_out(request.out, FILES)
    from xfrustum.reports.verification import baseline as accepted

    if request.baseline is not None:
        accepted.check_folder(request.baseline["folder"])
        # A damaged baseline is refused before the plate is judged.
        accepted.accepted_runs(request.baseline["folder"])
    verification = request.verified(opened)
    if verification is None:
        options.note("this part is judged; the last part to be finished writes the verification")
        return 0
    options.warn_of(opened)
    encoding = request.judged["encoding"]
    # If files have no triangle or object numbers, the stated encoding had no effect: warn the user.
    if encoding in ("triangle-id", "object-id") and verification.judged.startswith("colors"):
        options.note(
            f"files without numbers (OpenEXR without id.*): --encoding {encoding} is not used"
        )
    if request.out is not None:
        write_verification(verification, request.out)
    if request.junit is not None:
        write_junit(verification, request.junit)
    if request.baseline is None:
        request.tell(verification.summary, lambda: table(verification))
        return 0 if verification.kept else options.LIMIT_EXCEEDED
    stated_ = {name: request.judged[name] for name in ("near", "accept", "encoding")}
    if encoding == "rgb" and request.judged["command"] is None:
        # Treat an explicit default like an absent option: the verdict is the same.
        stated_["encoding"] = None
    folder = request.baseline.pop("folder")
    held = accepted.baseline(
        verification, folder, accepted.BaselineOptions(**stated_, **request.baseline)
    )
    problem = accepted.append_step_summary(held)
    if problem is not None:
        options.note(problem)
    # With accepted measures, limits count only if the user sets them.
    limits = ("max_wrong", "max_displacement_px", "max_color", "until")
    stated = any(map(options.is_given, limits))
    limited = stated or not (held.compared or held.approved)
    passed = held.passed and (verification.kept or not limited)
    text = f"{table(verification)}\n{accepted.lines(held)}"
    if passed and not verification.kept:
        # Default limits may be exceeded, as they were in the accepted run.
        text += "\nexit status 0: nothing is worse than accepted, and no limit is stated"
    request.tell(lambda: {**verification.summary(), "baseline": held.summary()}, lambda: text)
    return 0 if passed else options.LIMIT_EXCEEDED


class _Camera(options.Printed):
    scene = options.scene_argument
    renderer = choice(
        "blender json gltf mitsuba",
        "Target: blender (crossed frustum and render script), else C and C* in the format.",
        "--for",
        required=True,
    )
    apertures = option(
        options.INDICES, "Apertures, such as 40,30;0,0.  [default: as `report`; blender: all]"
    )
    settings = options.settings_options()
    out = option(options.FOLDER, "Folder for the camera files.", required=True)


@options.command("xfrustum camera asymmetric --for json --near 0.1 --out cameras")
def camera(request: _Camera) -> None:
    """Write the cameras of a plate for another renderer.

    `json` has matrices, planes, depth functions and tests of every pass; `gltf` has a node for each
    camera; `mitsuba` has a sensor plugin for each camera, as a dict. `blender` writes
    DIR/render.py, which renders any apertures in Blender 4.5 or newer, exactly and in one pass
    each (docs/blender.md). All write scene.npz with the numbered triangles and objects.
    """
    opened = options.open_scene(request.scene)
    from xfrustum.reports.exchange.cameras import write_cameras

    indices = request.apertures
    chosen = None if indices is None else [opened.plate.aperture(*index) for index in indices]
    written = write_cameras(opened, request.renderer, request.out, request.settings, chosen)
    request.tell(
        lambda: {"for": written.renderer, "files": written.files, "next": written.next_step},
        lambda: "\n".join((*map(str, written.files), written.next_step)),
    )


_KNOWN = tuple(f"L{number}" for number in range(7))
_LEVEL = options.Read(
    "LEVEL", lambda text: _KNOWN[_KNOWN.index(text.upper())], f"one of {', '.join(_KNOWN)}"
)
_LEVELS = options.list_of(_LEVEL)
_NAMES = options.list_of(options.Read("NAME", str, "names of cases"))
#: keys of case.json that `show` prints
_SHOWN = ("name", "level", "why", "asked", "accepted", "hogels", "resolution", "near", "depth",
          "mapping")  # fmt: skip


@click.group(
    no_args_is_help=False,
    epilog="\b\nExample:\n  xfrustum conformance run --python renderer:draw --level L0",
)
def conformance() -> None:
    """Judge a renderer by a frozen suite of test cases, and write a statement of conformance."""


class _Chosen(options.Measured):
    level = option(_LEVELS, "Levels of cases, such as L0,L1.  [default: all]", default=())
    case = option(_NAMES, "Names of cases.  [default: all]", default=())

    @property
    def cases(self) -> tuple[Case, ...]:
        """Cases of the levels and names in the options."""
        from xfrustum.scenes.conformance_suite import chosen

        return chosen(self.level, self.case)


@options.command("xfrustum conformance list --level L0", conformance)
def list_(request: _Chosen) -> None:
    """List the cases of the suite."""
    from xfrustum.scenes.conformance_suite import SUITE

    cases = request.cases
    names = ("name", "level", "hogels", "digest")
    entries = [{name: getattr(case, name) for name in names} for case in cases]

    width = max((len(case.name) for case in cases), default=0)
    lines = [
        f"{case.name:<{width}}  {case.encoding:<11}  {len(case.hogels)} hogels  {case.why}"
        for case in cases
    ]
    lines.append(f"suite {SUITE}: {len(cases)} cases")
    request.tell(lambda: {"suite": SUITE, "cases": entries}, lambda: "\n".join(lines))


class _Show(options.Printed):
    name: str = options.argument()
    out = option(FOLDER, "Folder for the input files of the case and its true images.")


@options.command("xfrustum conformance show L0-behind --out first", conformance)
def show(request: _Show) -> None:
    """Print a case; with --out, write its input files to case/ and its true images to truth/."""
    from xfrustum.scenes.conformance_suite import chosen

    # An unknown name raises InputError with the list of known names.
    (case,) = chosen(names=(request.name,))
    from xfrustum.reports import conformance, conformance_cases
    from xfrustum.reports.common.outputs import refused

    scene = case.open()
    described = conformance_cases.described(case, scene)
    if request.out is not None:
        with refused(f"--out {request.out}: cannot write there"):
            conformance_cases.write_case(case, scene, request.out / "case")
            (request.out / "truth").mkdir(exist_ok=True)
            for truth in conformance_cases.traced(case, scene):
                index = truth.camera.aperture.index
                conformance.write_hogel(
                    case, request.out / "truth", index, conformance.encoded_truth(case, truth)
                )
    lines = [
        *(f"{key}: {described[key]}" for key in _SHOWN if described[key] is not None),
        f"triangles: {len(scene.faces):,} in {len(scene.objects)} objects",
        f"digest: {case.digest}",
    ]
    request.tell(lambda: {**described, "digest": case.digest}, lambda: "\n".join(lines))


class _Judged(_Chosen):
    truths = option(
        FOLDER, "Archive of `conformance export`: unpack truths instead of tracing them.", "--truth"
    )
    renderer = option(TEXT, "Name of the renderer in the statement.  [default: as given]")
    device = option(TEXT, "Device that drew: its device.json, or a name.")
    out = option(FOLDER, "Folder for index.html, junit.xml, statement.json, badge.json.")

    def judge(self, renderer: CaseRenderer) -> int:
        """Judge the renderer by the cases, write and print verdicts; return the exit status."""
        if not self.cases:
            raise click.UsageError("no case has these names in these levels")
        from xfrustum.compare.judging.judged import ANY_DEVICE
        from xfrustum.reports import conformance
        from xfrustum.reports.conformance_cases import Archive, traced
        from xfrustum.scenes.model.device_model import DeviceModel

        options.check_out(self.out, conformance.FILES)
        # Without a device.json, any rounding that OpenGL permits is accepted.
        name, model = self.device or "not stated", ANY_DEVICE
        if name.endswith(".json"):
            # Verdicts are stricter: pixels must follow the rounding of this device.
            model = DeviceModel.read(Path(name))
            name = model.name
        judging = conformance.RunOptions(
            truths=traced if self.truths is None else Archive(path=self.truths.absolute()),
            device=model,
            pictures=self.out is not None,
        )
        result = conformance.Statement(
            renderer=self.renderer or renderer.name,
            device=name,
            device_model=model.name,
            verdicts=conformance.run(self.cases, renderer, judging, progress=self.progress),
        )
        if self.out is not None:
            conformance.write_statement(result, self.out)
        self.tell(result.summary, result.table)
        return 0 if result.passed else options.LIMIT_EXCEEDED


class _Run(_Judged):
    command = option(TEXT, "Program to run once for each case, such as 'my-renderer {case} {out}'.")
    images = option(
        TEXT, "Folder of finished images: DIR/NAME/hogel_{i}x{j}.png or .exr; NAME is the case."
    )
    python = option(TEXT, "Python function to call, module:function.")
    timeout_s = option(
        POSITIVE, "Time limit of the program for each case, seconds.", "--timeout", default=60.0
    )


@options.command(
    "xfrustum conformance run --command 'my-renderer {case} {out}' --out statement", conformance
)
def run(request: _Run) -> int:
    """Run a renderer on each case of the suite and judge its images; exit status 1 if a case fails.

    For each case the folder {case} holds scene.obj, scene.glb, cameras.json, scene.npz and
    case.json. The renderer writes {out}/hogel_{i}x{j}.png or .exr for each hogel of case.json, or a
    file {out}/unsupported with the reason.
    """
    from xfrustum.scenes.arguments import check_program

    if request.command is not None:
        # Test the program before imports that take seconds.
        check_program(request.command)
    from xfrustum.reports.conformance import CaseRenderer

    return request.judge(
        CaseRenderer(
            command=request.command,
            images=request.images,
            python=request.python,
            timeout_s=request.timeout_s,
        )
    )


class _Judge(_Judged):
    images: str = options.argument()


@options.command("xfrustum conformance judge images --truth conformance-1.0.zip", conformance)
def judge(request: _Judge) -> int:
    """Judge finished images, IMAGES/NAME/hogel_{i}x{j}.png or .exr; exit status as for `run`."""
    from xfrustum.reports.conformance import CaseRenderer

    return request.judge(CaseRenderer(images=request.images))


class _Export(_Chosen):
    out: Path = option(FOLDER, "Folder for the archive.", required=True)


@options.command("xfrustum conformance export --out archive", conformance)
def export(request: _Export) -> None:
    """Write an archive of all case folders and true images, for machines that cannot trace."""
    from xfrustum.reports import conformance_cases
    from xfrustum.reports.common.outputs import progress_bar

    with progress_bar(len(request.cases), "export", "case", shown=request.progress) as bar:
        path = conformance_cases.export(request.cases, request.out, bar.update)
    # Size of the finished archive, which `export` has renamed into place.
    size = path.stat().st_size
    request.tell(
        lambda: {"archive": str(path), "bytes": size, "cases": len(request.cases)},
        lambda: f"{path}: {len(request.cases)} cases, {size / 1e6:.1f} MB",
    )
