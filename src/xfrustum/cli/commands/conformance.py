"""`conformance`: judge a renderer by a frozen suite of cases, and write a citable statement."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, POSITIVE, TEXT, option

if TYPE_CHECKING:
    from xfrustum.reports.conformance import CaseRenderer
    from xfrustum.scenes.conformance_suite import Case

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
