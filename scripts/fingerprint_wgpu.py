"""Draws the fingerprint of `xfrustum device` through WebGPU, on Vulkan, and prints what it measures as JSON.

    pip install --target build/wgpu wgpu numpy==<that of the environment>
    PYTHONPATH=build/wgpu .venv/bin/python scripts/fingerprint_wgpu.py

Mesa's lavapipe is in the package mesa-vulkan-drivers. Clip depth runs from 0 to 1 for all
triangles. WebGPU copies no depth of 24 bits, which is left out, and tells no subpixel bits, so that
all that are tried compete.
"""

import json
import sys

import numpy as np
import wgpu

from xfrustum.compare.device.fingerprints import MOST_SUBPIXEL_BITS, Measured
from xfrustum.raster.device.fingerprint import (
    EMPTY,
    SIZE,
    WRITTEN,
    Fingerprint,
    edge_triangles,
    fingerprint_triangles,
)
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate.double_frustum import DepthFormat

READ = {
    DepthFormat.D16: ("depth16unorm", np.uint16),
    DepthFormat.D32F: ("depth32float", np.float32),
}
OUT = "struct Out { @location(0) o: vec4f, @location(1) q: vec4f"
PLACE = "let n = i32(at.y) * 64 + i32(at.x);"

TRIANGLE = f"""
struct Between {{ @builtin(position) at: vec4f, @location(0) s: vec2f,
  @location(1) @interpolate(linear) l: vec2f, @location(2) @interpolate(flat) c: vec2f }}
{OUT} }}
@vertex fn vs(@location(0) p: vec4f, @location(1) a: vec2f) -> Between {{ return Between(p, a, a, a); }}
@fragment fn fs(i: Between) -> Out {{ return Out(vec4f(i.at.z, i.at.w, i.s), vec4f(i.l, i.c)); }}"""

WHOLE = """
@vertex fn vs(@location(0) p: vec4f, @location(1) a: vec2f) -> @builtin(position) vec4f { return p; }"""
# Rows count down in WebGPU, and up in a fingerprint: the place is that of the row from the bottom.
WRITES = f"""{WHOLE}
{OUT}, @builtin(frag_depth) d: f32 }}
@group(0) @binding(0) var<uniform> asked: vec4f;
@fragment fn fs(@builtin(position) at: vec4f) -> Out {{ {PLACE}
  let d = bitcast<f32>(bitcast<i32>(asked.x) + n * i32(asked.y)); return Out(vec4f(d), vec4f(d), d); }}"""
FILTERS = f"""{WHOLE}
{OUT} }}
@group(0) @binding(0) var t: texture_2d<f32>; @group(0) @binding(1) var s: sampler;
@fragment fn fs(@builtin(position) at: vec4f) -> Out {{ {PLACE}
  let f = textureSample(t, s, vec2f((0.5 + (f32(n) + 0.5) / 4096.0) / 2.0, 0.5)); return Out(f, f); }}"""
COVERS = np.array([[-1, -1, 0, 1, 0, 0], [3, -1, 0, 1, 0, 0], [-1, 3, 0, 1, 0, 0]], np.float32)


class Canvas:
    """Two pictures and a depth buffer of each format that can be read."""

    def __init__(self, device):
        self.device = device
        usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
        size = (SIZE, SIZE, 1)
        self.pictures = [
            device.create_texture(size=size, format="rgba32float", usage=usage) for _ in range(2)
        ]
        self.depths = {
            d: device.create_texture(size=size, format=name, usage=usage)
            for d, (name, _) in READ.items()
        }

    def pipeline(self, code, depth):
        """Return a pipeline for one program and depth format."""
        module = self.device.create_shader_module(code=code)
        attributes = [
            {"format": "float32x4", "offset": 0, "shader_location": 0},
            {"format": "float32x2", "offset": 16, "shader_location": 1},
        ]
        return self.device.create_render_pipeline(
            layout="auto",
            vertex={
                "module": module,
                "entry_point": "vs",
                "buffers": [{"array_stride": 24, "attributes": attributes}],
            },
            fragment={
                "module": module,
                "entry_point": "fs",
                "targets": [{"format": "rgba32float"}] * 2,
            },
            primitive={"topology": "triangle-list"},
            depth_stencil={
                "format": READ[depth][0],
                "depth_write_enabled": True,
                "depth_compare": "always",
            },
        )

    def draw(self, pipeline, corners, depth, bound=()):
        """Draw corners (3, 6) into cleared pictures; return both, and the depths, rows from the bottom."""
        buffer = self.device.create_buffer_with_data(
            data=np.ascontiguousarray(corners, np.float32), usage=wgpu.BufferUsage.VERTEX
        )
        encoder = self.device.create_command_encoder()
        targets = [
            {
                "view": one.create_view(),
                "load_op": "clear",
                "store_op": "store",
                "clear_value": (EMPTY,) * 4,
            }
            for one in self.pictures
        ]
        into = {"view": self.depths[depth].create_view(), "depth_clear_value": 0.0}
        begun = encoder.begin_render_pass(
            color_attachments=targets,
            depth_stencil_attachment=into | {"depth_load_op": "clear", "depth_store_op": "store"},
        )
        begun.set_pipeline(pipeline)
        if bound:
            entries = [{"binding": i, "resource": one} for i, one in enumerate(bound)]
            layout = pipeline.get_bind_group_layout(0)
            begun.set_bind_group(0, self.device.create_bind_group(layout=layout, entries=entries))
        begun.set_vertex_buffer(0, buffer)
        begun.draw(3)
        begun.end()
        self.device.queue.submit([encoder.finish()])
        return (*(self.read(one, np.float32, 4) for one in self.pictures), self.read_depth(depth))

    def read_depth(self, depth):
        """Return the stored depths of a format."""
        return self.read(self.depths[depth], READ[depth][1], 1)[..., 0]

    def read(self, texture, dtype, channels):
        """Return a texture (H, W, C), rows from the bottom; rows of copies are multiples of 256 bytes."""
        row = max(SIZE * channels * np.dtype(dtype).itemsize, 256)
        usage = wgpu.BufferUsage.COPY_DST | wgpu.BufferUsage.MAP_READ
        buffer = self.device.create_buffer(size=row * SIZE, usage=usage)
        encoder = self.device.create_command_encoder()
        encoder.copy_texture_to_buffer(
            {"texture": texture}, {"buffer": buffer, "bytes_per_row": row}, (SIZE, SIZE, 1)
        )
        self.device.queue.submit([encoder.finish()])
        buffer.map_sync("READ")
        rows = np.frombuffer(bytes(buffer.read_mapped()), dtype).reshape(SIZE, -1)[
            :, : SIZE * channels
        ]
        buffer.unmap()
        return rows.reshape(SIZE, SIZE, channels)[::-1].copy()


def draw(adapter):
    """Return the fingerprint of a device."""
    device = adapter.request_device_sync(required_features=["float32-filterable"])
    canvas = Canvas(device)
    pipelines = {depth: canvas.pipeline(TRIANGLE, depth) for depth in READ}
    drawn = list(fingerprint_triangles())
    stored, pictures = {depth: [] for depth in READ}, []
    for corners, values in drawn:
        for depth, pipeline in pipelines.items():
            *both, depths = canvas.draw(pipeline, np.concatenate([corners, values], axis=1), depth)
            stored[depth].append(depths)
        pictures.append(both)
    edges, last = list(edge_triangles()), DepthFormat.D32F
    zeros = np.zeros((3, 2))
    covered = [
        canvas.draw(pipelines[last], np.hstack([one, zeros]), last)[0][..., 0] != EMPTY
        for one in edges
    ]
    texture = device.create_texture(
        size=(2, 1, 1),
        format="r32float",
        usage=wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST,
    )
    texels = np.array([0, 1], np.float32)
    device.queue.write_texture({"texture": texture}, texels, {"bytes_per_row": 8}, (2, 1, 1))
    sampler = device.create_sampler(mag_filter="linear", min_filter="linear")
    bound = (texture.create_view(), sampler)
    # Places count from the top here: the first row of the picture is the last of the array.
    filtered = canvas.draw(canvas.pipeline(FILTERS, last), COVERS, last, bound)[0][
        ::-1, :, 0
    ].ravel()
    written = {}
    for depth in READ:
        pipeline, pairs = canvas.pipeline(WRITES, depth), []
        for base, step in WRITTEN:
            asked = np.array([base, step, 0, 0], np.float32)
            buffer = device.create_buffer_with_data(data=asked, usage=wgpu.BufferUsage.UNIFORM)
            wrote, _, kept = canvas.draw(pipeline, COVERS, depth, ({"buffer": buffer},))
            pairs.append((wrote[..., 0].ravel(), kept.ravel()))
        written[depth] = tuple(np.concatenate(parts) for parts in zip(*pairs, strict=True))
    fragment, others = (np.array(parts) for parts in zip(*pictures, strict=True))
    return Fingerprint(
        device={
            "renderer": adapter.info["device"],
            "version": f"{adapter.info['backend_type']}, {adapter.info['description']}",
            "subpixel_bits": str(MOST_SUBPIXEL_BITS),
        },
        vertices=np.array([corners for corners, _ in drawn]),
        varyings=np.array([values for _, values in drawn]),
        zero_to_one=np.ones(len(drawn), np.bool_),
        stored={depth: np.array(pictures) for depth, pictures in stored.items()},
        written=written,
        fragment=fragment,
        others=others,
        filtered=filtered,
        edge_vertices=np.array(edges),
        covered=np.array(covered),
    )


def main():
    """Measure, and print: `within` are numbers of pixels in the bounds of the model beside it."""
    measured = Measured(draw(wgpu.gpu.request_adapter_sync()))
    d16, d24 = measured.stored_range(DepthFormat.D16), (-0.5, 0.5)
    model = DeviceModel(
        name=measured.fingerprint.device["renderer"],
        subpixel_bits=measured.subpixel_bits,
        snaps_depth=measured.snaps_depth,
        d16=d16,
        d24=d24,
        filter_bits=measured.filter_bits,
    )
    within = {depth.value: vars(measured.within(model, depth)) for depth in READ}
    within |= {
        "varyings": vars(measured.varyings_within(model)),
        "filter": vars(measured.filtered_within(model)),
    }
    found = {
        **measured.fingerprint.device,
        "viewport": measured.viewport,
        "ties": measured.ties,
        "cut_from_px": measured.cut_from_px,
        "cuts": measured.cuts,
        "plane_noise": measured.plane_noise,
        "written": {d.value: measured.written_steps(d) for d in READ},
        "interpolated": {d.value: measured.interpolated_steps(d) for d in READ},
        "varyings": measured.varyings(),
        "within": within,
        "model": model.as_json(),
    }
    json.dump(found, sys.stdout, indent=1)


if __name__ == "__main__":
    main()
