"""Rates of exact rays, trimesh's two classes and bare Embree, in million rays per second."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector as EmbreeIntersector
from trimesh.ray.ray_triangle import RayMeshIntersector as NativeIntersector

from xfrustum.rays import ExactIntersector
from xfrustum.reference.tracers import EmbreeMesh
from xfrustum.reports.common import outputs
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.common.timing import race
from xfrustum.reports.text import aligned
from xfrustum.research.benchmarks import Record
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.arrays import Floats

RAYS_MEANINGS = {
    "exact": "ExactIntersector.intersects_first",
    "embree": "intersects_first of trimesh's Embree class, on one thread",
    "native": "intersects_first of trimesh's own class, which needs rtree; fewer rays",
    "bare": "Embree through embreex on all processors, robust, rays at hand in float32",
}

#: number of rays in a run, and in a run of trimesh's own class, which takes some 0.02 s per ray
RAYS, NATIVE_RAYS = 1_000_000, 100

#: distance between the origin and the touched point of a grazing ray, in sizes of the mesh
GRAZING_START = 2.0

#: distance of grazing rays from vertices, in sizes of the mesh
OFF_VERTICES = 1e-4


def default_meshes() -> dict[str, trimesh.Trimesh]:
    """Return a sphere, the car, and the scan of the test data if it exists."""
    car = open_scene("car")
    meshes = {
        "sphere": trimesh.creation.icosphere(subdivisions=6),
        "car": trimesh.Trimesh(car.vertices, car.faces, process=False),
    }
    scan = Path(__file__).resolve().parents[2] / "shared" / "data" / "stanford-bunny.obj"
    if scan.exists():
        meshes[scan.stem] = read_mesh(scan)
    return meshes


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Return the mesh of a file; InputError if trimesh reads no triangles."""
    try:
        mesh = trimesh.load(path, process=False, force="mesh")
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: trimesh cannot read it ({error}); name a mesh file") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError(f"{path}: has no triangles to measure; name a mesh that has")
    return mesh


def rays_of_kinds(mesh: trimesh.Trimesh, count: int) -> dict[str, tuple[Floats, Floats]]:
    """Return origins and directions (count, 3) of each kind of rays."""
    rng = np.random.default_rng(1)
    low, high = mesh.bounds
    size = float(np.linalg.norm(high - low))
    inside = rng.uniform(low, high, (count, 3))
    # Rays through a square film, from a point in front of the mesh's middle.
    side = int(np.ceil(np.sqrt(count)))
    u, v = np.divmod(np.arange(count), side)
    film = np.stack((v / side - 0.5, 0.5 - u / side, np.full(count, -1.0)), axis=1)
    eye = (low + high) / 2 + [0.0, 0.0, 1.2 * size]
    # Tangents beside vertices: rays through a vertex itself would all be decided in integers.
    vertex = rng.integers(0, len(mesh.vertices), count)
    tangent = np.cross(mesh.vertex_normals[vertex], rng.normal(size=(count, 3)))
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    # Vertices without triangles have no normal.
    tangent = np.where(length > 0, tangent / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0])
    touched = mesh.vertices[vertex] + rng.normal(scale=OFF_VERTICES * size, size=(count, 3))
    return {
        "random": (inside, rng.normal(size=(count, 3))),
        "coherent": (np.tile(eye, (count, 1)), film),
        "grazing": (touched - GRAZING_START * size * tangent, tangent),
    }


def benchmark_rays(
    meshes: Mapping[str, trimesh.Trimesh],
    rays: int = RAYS,
    repeat: int = 5,
    *,
    progress: bool = False,
) -> Record:
    """Time first hits of random, coherent and grazing rays; programs take turns."""
    races: list[Record] = []
    turns = len(meshes) * 3 * (repeat + 1) * len(RAYS_MEANINGS)
    with progress_bar(turns, "bench", "run", shown=progress) as bar:
        for name, mesh in meshes.items():
            exact, built = ExactIntersector(mesh), {}
            embree, native = EmbreeIntersector(mesh), NativeIntersector(mesh)
            first = np.zeros((1, 3)), np.ones((1, 3))
            for contestant, intersector in (("exact", exact), ("embree", embree)):
                begun = time.perf_counter()
                intersector.intersects_first(*first)
                built[contestant] = time.perf_counter() - begun
            bare = EmbreeMesh(mesh.vertices, mesh.faces)
            for kind, lines in rays_of_kinds(mesh, rays).items():
                few = tuple(part[:NATIVE_RAYS] for part in lines)
                singles = tuple(part.astype(np.float32) for part in lines)
                runs: dict[str, Callable[[], object]] = {
                    "exact": partial(exact.intersects_first, *lines),
                    "embree": partial(embree.intersects_first, *lines),
                    "bare": partial(bare.first_hits, *singles),
                }
                if find_spec("rtree") is not None:
                    runs["native"] = partial(native.intersects_first, *few)
                seconds = race(runs, repeat, bar.update)
                counts = {"native": len(few[0])}
                rates = {
                    each: counts.get(each, rays) / 1e6 / taken.median
                    for each, taken in seconds.items()
                }
                races.append(
                    {
                        "mesh": name,
                        "triangles": len(mesh.faces),
                        "rays": rays,
                        "kind": kind,
                        "rates": {each: rates.get(each) for each in RAYS_MEANINGS},
                        "ratios": {
                            f"exact/{other}": rates["exact"] / rates[other]
                            if other in rates
                            else None
                            for other in ("embree", "native")
                        },
                        "build_s": built,
                    }
                )
    machine = outputs.machine()
    return {
        "races": races,
        "repeat": repeat,
        "meanings": RAYS_MEANINGS,
        "arrays": machine["arrays"],
        "machine": machine,
        "versions": {name: version(name) for name in ("drjit", "embreex", "trimesh")},
    }


def rays_table(record: Record) -> str:
    """Return rates and ratios as text, one row for each kind of rays."""
    names = list(RAYS_MEANINGS)
    rows: list[list[str]] = [["mesh", "triangles", "rays", *names, "exact/embree", "exact/native"]]
    for each in record["races"]:
        numbers = [*(each["rates"][name] for name in names), *each["ratios"].values()]
        cells = ["-" if number is None else f"{number:.3g}" for number in numbers]
        rows.append([each["mesh"], f"{each['triangles']:,}", each["kind"], *cells])
    machine: Any = record["machine"]
    where = f"{machine['cores']} cores of {machine['processor']}; arrays on {record['arrays']}"
    head = f"million rays per second, median of {record['repeat']} after a warm-up\n{where}"
    legend = "\n".join(f"{name}: {meaning}" for name, meaning in RAYS_MEANINGS.items())
    return "\n\n".join((head, aligned(rows, str.ljust), legend))
