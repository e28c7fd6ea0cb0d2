"""Shaders of the folder `shaders`, assembled for a choice of effects."""

from collections.abc import Iterable, Mapping
from importlib.resources import files

import moderngl

from xfrustum.raster.cameras.cameras import Mapping as OpenGLMapping
from xfrustum.raster.cameras.cameras import Pass
from xfrustum.scenes.model.effects import Effect

#: Effects computed in the picture's shaders; all others are separate cameras or passes
SHADING = (
    Effect.SMOOTH_NORMALS,
    Effect.VERTEX_COLORS,
    Effect.TEXTURES,
    Effect.AMBIENT,
    Effect.DIFFUSE,
    Effect.SPECULAR,
)

#: names that a shader tests with `#ifdef`, and their values
Defines = Mapping[str, str]


def shader(name: str) -> str:
    """Return a file of the folder `shaders`, with its includes replaced by the included files."""
    text = (files("xfrustum.raster") / "shaders" / name).read_text()
    lines = []
    for line in text.splitlines():
        word, _, included = line.partition(" ")
        lines.append(shader(included.strip('"')) if word == "#include" else line)
    return "\n".join(lines) + "\n"


def defined(source: str, defines: Defines) -> str:
    """Return a shader with definitions inserted after the first line, the GLSL version."""
    version, rest = source.split("\n", 1)
    return "\n".join(
        (version, *(f"#define {name} {value}" for name, value in defines.items()), rest)
    )


def defines_of(effects: Iterable[Effect]) -> dict[str, str]:
    """Return the definitions that enable the effects of `SHADING` in the shaders."""
    chosen = frozenset(effects)
    return {effect.name: "1" for effect in SHADING if effect in chosen}


def picture_defines(mapping: OpenGLMapping, effects: Iterable[Effect] | None) -> dict[str, str]:
    """Return the definitions for hogel.frag, of depth and effects; no color if None."""
    depth = {"FRAGMENT_DEPTH": f"({mapping.fragment_depth})"} if mapping.fragment_depth else {}
    return depth if effects is None else {"SHADED": "1", **defines_of(effects), **depth}


def reflection_defines(effects: Iterable[Effect]) -> dict[str, str]:
    """Return the definitions for reflection.frag: smooth normals or none."""
    return defines_of(frozenset(effects) & {Effect.SMOOTH_NORMALS})


def program(context: moderngl.Context, fragment: str, defines: Defines) -> moderngl.Program:
    """Return the program of `hogel.vert` and a fragment shader."""
    return context.program(
        vertex_shader=defined(shader("hogel.vert"), defines),
        fragment_shader=defined(shader(fragment), defines),
    )


def assign(program: moderngl.Program, **uniforms: object) -> None:
    """Set the uniforms that the program has; the compiler drops unused ones."""
    for name, value in uniforms.items():
        if name in program:
            program[name] = value


def set_camera(program: moderngl.Program, number: int, camera: Pass, size: tuple[int, int]) -> None:
    """Set the uniforms of a camera with its number in drawing order, and W, H of the image."""
    near, far = camera.planes
    assign(
        program,
        clip_from_scene=tuple(camera.clip_from_scene.T.ravel().tolist()),
        near=near,
        far=far,
        conjugate=1.0 if camera.orthoscopic else -1.0,
        pixels=tuple(float(n) for n in size),
        camera=number,
    )
    if "line_of_pixel" in program:
        program["line_of_pixel"] = tuple(camera.line_of_pixel.T.ravel().tolist())


def set_facing(context: moderngl.Context, camera: Pass) -> None:
    """Set the winding of faces turned to a camera, and the culled faces."""
    context.front_face = camera.front_face
    if camera.culled_face is None:
        context.disable(moderngl.CULL_FACE)
    else:
        context.cull_face = camera.culled_face
        context.enable(moderngl.CULL_FACE)
