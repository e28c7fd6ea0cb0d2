"""Sentences about layouts: evidence for a recognized one, losses of a written one, notes."""

from xfrustum.scenes.files.layouts import Target
from xfrustum.scenes.files.plate_files import FileSet, PlateRows


def reasons(files: FileSet) -> tuple[str, ...]:
    """Return the evidence for the layout of some files, one clause each."""
    count, total = len(files.files), files.layout.file_count(files.shape)
    fit = f"{count} of {count + files.strangers} names fit: {files.layout.meaning}"
    lacking = [f"{files.missing} of {total} files are not there"] if files.missing else []
    return fit, f"such as {files.files[min(files.files)].name}", *lacking, str(files.shape)


def described(files: FileSet) -> str:
    """Return layout and evidence in one line."""
    return f"{files.layout.name} ({'; '.join(reasons(files))})"


def losses(plate: PlateRows, target: Target) -> tuple[str, ...]:
    """Return the data that a layout cannot store, one clause each."""
    clauses, height = [], plate.shape.resolution[1]
    if target.layout.horizontal and height > 1:
        clauses.append(
            f"vertical parallax: of {height} rows of pixels of each hogel, row {height // 2} "
            "(from 0 at the top) is kept"
        )
    if plate.floating and not target.floating:
        clauses.append(
            "floating-point numbers: radiance is clipped to 0 and 1 and rounded to 255 levels"
        )
    return tuple(clauses)


def notes(plate: PlateRows, target: Target) -> tuple[str, ...]:
    """Return the expectations of a layout's readers that its files do not meet."""
    # Facts about other programs that no pixel of the files shows.
    if target.layout.name == "burnett":
        return ("its own renderer samples pixels at their corners; re-arranging moves no sample",)
    if target.layout.name != "quilt":
        return ()
    encoding = "pixels are encoded as in the files that were read; displays take them for sRGB"
    if plate.linear:
        chunk = "" if target.floating else " (a PNG file says so: gAMA)"
        encoding = (
            "pixels are linear radiance, as the plate stores them, and displays take them for "
            f"sRGB{chunk}; `view --quilt` writes sRGB"
        )
    spacing = "views are evenly spaced on the film (in tangents), a display's eyes evenly in angle"
    return spacing, encoding


def missing_hogels(count: int) -> tuple[str, ...]:
    """Return the note about hogels that a Zarr group lacks."""
    return (f"{count} hogels are not there and count as empty",) if count else ()


def incomplete(files: FileSet, *, stated: bool) -> str | None:
    """Return the reason why files cannot be converted; None if the plate is complete.

    `stated` is whether the user gave the number of hogels.
    """
    name, shape = files.layout.name, files.shape
    if files.missing:
        return f"{files.missing} files of the layout {name} are not there, for a plate of {shape}"
    if files.beyond:
        advice = "leave out --hogels, or give all of them" if stated else "move the others away"
        return (
            f"{files.beyond} of {len(files.files)} files of the layout {name} lie beyond a plate "
            f"of {shape}; {advice}"
        )
    return None
