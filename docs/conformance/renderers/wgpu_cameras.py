"""Draw the two cameras of each case by wgpu-py (WebGPU) on Vulkan, Metal or Direct3D.

    pip install wgpu pillow
    xfrustum conformance export --out archive
    python wgpu_cameras.py archive/conformance-1.0.zip images
    xfrustum conformance judge images --truth archive/conformance-1.0.zip

Vertices and matrices are float32, as in a game engine. The script does not import xfrustum.
"""

import json
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import wgpu
from lines import asked_for, check_numbers, check_two_cameras
from PIL import Image

SHADER = """
struct Camera { clip_from_scene: mat4x4f, planes: vec4f };
@group(0) @binding(0) var<uniform> camera: Camera;
struct Seen {
    @builtin(position) clip: vec4f, @location(0) @interpolate(flat) number: u32, @location(1) w: f32,
};
struct Stored { @location(0) number: u32, @builtin(frag_depth) depth: f32 };

@vertex fn corner(@location(0) place: vec3f, @builtin(vertex_index) index: u32) -> Seen {
    let clip = camera.clip_from_scene * vec4f(place, 1.0);
    return Seen(clip, index / 3u + 1u, clip.w);
}
@fragment fn number(seen: Seen) -> @location(0) u32 { return seen.number; }
@fragment fn logarithmic(seen: Seen) -> Stored {
    return Stored(seen.number, log(seen.w / camera.planes.x) / log(camera.planes.y / camera.planes.x));
}
@fragment fn linear(seen: Seen) -> Stored {
    return Stored(seen.number, (seen.w - camera.planes.x) / (camera.planes.y - camera.planes.x));
}
"""
FORMATS = {"d16": "depth16unorm", "d24": "depth24plus", "d32f": "depth32float"}
TESTS = {"<": "less", ">": "greater"}
TARGET = wgpu.TextureUsage.RENDER_ATTACHMENT

device = wgpu.gpu.request_adapter_sync(power_preference="high-performance").request_device_sync()
module = device.create_shader_module(code=SHADER)


def pipeline_of(depth: dict[str, Any]) -> Any:
    """Return the pipeline of a pass with its depth format, test and mapping."""
    shader = depth["mapping"] if depth["written_by_fragment"] else "number"
    place = {"format": "float32x3", "offset": 0, "shader_location": 0}
    return device.create_render_pipeline(
        layout="auto",
        vertex={
            "module": module,
            "entry_point": "corner",
            "buffers": [{"array_stride": 12, "step_mode": "vertex", "attributes": [place]}],
        },
        primitive={"topology": "triangle-list", "cull_mode": "none"},
        depth_stencil={
            "format": FORMATS[depth["format"]],
            "depth_write_enabled": True,
            "depth_compare": TESTS[depth["test"]],
        },
        fragment={"module": module, "entry_point": shader, "targets": [{"format": "r32uint"}]},
    )


def uniforms(one: dict[str, Any]) -> Any:
    """Return matrix and planes of a pass in the shader's layout: the matrix by columns."""
    matrix = np.array(one["clip_from_scene"])
    if one["depth"]["clip_range"][0] < 0:  # WebGPU clips depth to 0..1; stored depths are equal
        matrix[2] = (matrix[2] + matrix[3]) / 2
    return np.concatenate((matrix.T.ravel(), [one["near"], one["far"], 0, 0])).astype(np.float32)


def draw(corners: Any, passes: list[dict[str, Any]], size: tuple[int, int]) -> Any:
    """Return triangle numbers plus one (H, W) for corners (3 F, 3), drawn in all passes."""
    width, height = size
    texture = device.create_texture(
        size=(width, height, 1), format="r32uint", usage=TARGET | wgpu.TextureUsage.COPY_SRC
    )
    vertices = device.create_buffer_with_data(data=corners, usage=wgpu.BufferUsage.VERTEX)
    encoder = device.create_command_encoder()
    for number, one in enumerate(passes):
        depth = one["depth"]
        pipeline = pipeline_of(depth)
        buffer = device.create_buffer_with_data(data=uniforms(one), usage=wgpu.BufferUsage.UNIFORM)
        kept = device.create_texture(
            size=(width, height, 1), format=FORMATS[depth["format"]], usage=TARGET
        )
        drawing = encoder.begin_render_pass(
            color_attachments=[
                {
                    "view": texture.create_view(),
                    "load_op": "load" if number else "clear",
                    "store_op": "store",
                    "clear_value": (0, 0, 0, 0),
                }
            ],
            depth_stencil_attachment={
                "view": kept.create_view(),
                "depth_load_op": "clear",
                "depth_store_op": "discard",
                "depth_clear_value": depth["clear"],
            },
        )
        bound = {"binding": 0, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
        drawing.set_pipeline(pipeline)
        drawing.set_bind_group(
            0, device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=[bound])
        )
        drawing.set_vertex_buffer(0, vertices)
        drawing.draw(len(corners))
        drawing.end()
    device.queue.submit([encoder.finish()])
    shown = device.queue.read_texture(
        {"texture": texture, "origin": (0, 0, 0)},
        {"offset": 0, "bytes_per_row": 4 * width, "rows_per_image": height},
        (width, height, 1),
    )
    return np.frombuffer(shown, np.uint32).reshape(height, width).astype(np.int64)


def main() -> None:
    """Draw the cases of an archive, each into its own folder."""
    archive, out = zipfile.ZipFile(sys.argv[1]), Path(sys.argv[2])
    for entry in archive.namelist():
        if not entry.endswith("/case.json"):
            continue
        asked = json.loads(archive.read(entry))
        folder = out / asked["name"]
        folder.mkdir(parents=True, exist_ok=True)
        with archive.open(entry.replace("case.json", "scene.npz")) as file:
            scene = dict(np.load(file))
        cameras = json.loads(archive.read(entry.replace("case.json", "cameras.json")))
        try:
            check_numbers(asked)
            check_two_cameras(scene, asked, cameras)
        except NotImplementedError as told:
            (folder / "unsupported").write_text(str(told))
            continue
        corners = np.ascontiguousarray(scene["vertices"][scene["faces"]].reshape(-1, 3), np.float32)
        for aperture in cameras["apertures"]:
            shown = np.zeros(asked["resolution"][::-1], np.int64)
            if aperture["passes"]:
                shown = draw(corners, aperture["passes"], asked["resolution"])
            number, (i, j) = asked_for(scene, asked, shown), aperture["aperture"]
            rgb = np.stack((number >> 16, number >> 8 & 255, number & 255), axis=-1).astype(
                np.uint8
            )
            Image.fromarray(rgb).save(folder / f"hogel_{i}x{j}.png")


if __name__ == "__main__":
    main()
