"""Effects that a scene needs, closed-form errors by depth, and visible effects of near."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from xfrustum.compare.prediction import band_limiting
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.reports.common.templates_environment import Filters, plain_text
from xfrustum.reports.text import aligned
from xfrustum.scenes import Aperture, DoubleFrustum, Scene
from xfrustum.scenes.model.effects import (
    CAMERAS,
    Decision,
    Effect,
    Question,
    Refusal,
    SlabContent,
    decide,
    slab_content,
    slab_contents,
)
from xfrustum.scenes.model.visibility import DepthBin, depth_bins
from xfrustum.scenes.plate import Camera
from xfrustum.scenes.representation import counted, digits, percent
from xfrustum.tolerances import TOLERANCE_PX

Sections = tuple[tuple[float, float], ...]  #: lowest and highest |z| of each slab of one side

#: default near offset, share of the longest reach
DEFAULT_NEAR_PER_REACH = 1e-3

#: numbers of sub-apertures whose errors are listed; a single one is the middle of the aperture
EXAMPLE_SUB_APERTURES = (1, 16, 256, 4096)


@dataclass(frozen=True, kw_only=True)
class EffectRow:
    """An effect or a sampling setting, whether it is used, and the reason."""

    name: str
    used: bool
    reason: str
    #: numbers of the objects that need the effect and may be visible
    objects: tuple[int, ...] = ()
    #: numbers of the objects that need the effect but cannot be visible
    out_of_sight: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneEffects:
    """Effects of the images of one aperture, determined from the scene without images."""

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    rows: tuple[EffectRow, ...]
    #: slabs of both cameras, from the back
    slabs: tuple[SlabContent, ...]
    #: content of the frustum by depth, with errors in closed form
    depths: dict[str, Any]
    #: `viewer_record`; None without a viewer
    viewer: dict[str, Any] | None = field(default=None)

    def summary(self) -> dict[str, Any]:
        """Return the keys that effects add to `check --json`."""
        sampling, used = self.scene.sampling, {row.name for row in self.rows if row.used}
        # The rasterizer draws one pass per slab with content, for the cameras in use.
        drawn = [slab for slab in self.slabs if slab.triangles and slab.camera.value in used]
        kinds = ("surfaces", "reflections") if Effect.REFLECTION in used else ("surfaces",)
        return {
            "aperture": self.aperture.index,
            "effects": self.rows,
            "depths": self.depths,
            "cameras": list(dict.fromkeys(slab.camera for slab in drawn)),
            "slabs": self.slabs,
            "passes": [
                {"camera": slab.camera, "heights": slab.heights, "draws": kind}
                for kind in kinds
                for slab in drawn
            ],
            "samples": {
                "pixel": sampling.supersample**2,
                "multisample": sampling.multisample,
                "aperture": sampling.aperture,
            },
            "transport": self.scene.transport,
        } | ({} if self.viewer is None else {"viewer": self.viewer})

    def table(self) -> str:
        """Return the effects, the errors by depth and the limits of the viewer as text."""
        units = self.scene.units
        effects = [("effect", "", "because")]
        effects += [(row.name, "used" if row.used else "left out", row.reason) for row in self.rows]
        head = ("surface", "near offset", "pivot camera", "separation", "blur", "sub-apertures")
        by_depth: list[tuple[str, ...]] = [(f"|z| ({units})", *head)]
        for content in self.depths["rows"]:
            blur = (digits(b) if math.isfinite(b) else "any" for b in content["blur_px"])
            by_depth.append(
                (
                    f"{digits(content['nearest'])} to {digits(content['farthest'])} "
                    f"{content['side']}",
                    percent(content["share"]),
                    f"{digits(content['near_px'])} px",
                    f"{digits(content['shear_px'])} px",
                    f"{digits(content['separation'])} {units}",
                    f"{' to '.join(blur)} px",
                    _points(content["sub_apertures"]),
                )
            )
        values = {
            "plan": self,
            **self.summary(),
            "units": units,
            "effects": aligned(effects, str.ljust),
            "by_depth": aligned(by_depth, str.ljust),
        }

        def depth(value: float) -> str:
            return "any depth" if math.isinf(value) else f"{digits(value)} {units}"

        filters: Filters = {"points": _points, "depth": depth}
        return plain_text("check-effects.txt.j2", values, filters).removesuffix("\n")


def scene_effects(
    scene: Scene,
    aperture: Aperture | None = None,
    settings: DoubleFrustum | None = None,
    viewer_distance: float | None = None,
) -> SceneEffects:
    """Return the effects of an aperture's images, determined from the scene without images.

    `aperture` None selects the middle one, and `settings` None `default_near` without cuts. Raises
    InputError if the settings do not fit the scene, or a surface is behind the viewer.
    """
    aperture = aperture or scene.plate.middle
    settings = settings or DoubleFrustum(near=default_near(scene))
    settings.check_against(scene.frustum)
    question = Question(camera=settings.camera, apertures=(aperture,), settings=(settings,))
    rows = effect_rows(scene, question)
    # Antialiasing, band limiting and light paths are used only on request.
    sampling, transport = scene.sampling, scene.transport
    side, many, points = sampling.supersample, sampling.multisample, sampling.aperture
    smooth = f"{side} x {side} points a pixel and {counted(many, 'coverage sample')} are asked for"
    paths = f"asked for, with {transport.samples} light paths a pixel"
    for name, used, reason in (
        ("antialiasing", side > 1 or many > 1, smooth),
        ("band-limiting", points > 1, f"{points} sub-apertures are asked for"),
        ("shadows", transport.shadows, paths),
        ("interreflection", transport.interreflection, paths),
    ):
        rows.append(EffectRow(name=name, used=used, reason=reason if used else "not asked for"))
    viewer = None if viewer_distance is None else viewer_record(scene, viewer_distance, settings)
    return SceneEffects(
        scene=scene,
        aperture=aperture,
        settings=settings,
        rows=tuple(rows),
        slabs=slab_contents(scene, settings),
        depths=depths(scene, aperture, settings),
        viewer=viewer,
    )


def effect_rows(scene: Scene, question: Question | None = None) -> list[EffectRow]:
    """Return the decision about every local effect, with the reason."""
    camera = Camera.BOTH if question is None else question.camera
    return [
        EffectRow(
            name=fact.effect,
            used=fact.used,
            reason=effect_reason(scene, fact, camera),
            objects=fact.objects,
            out_of_sight=fact.out_of_sight,
        )
        for fact in decide(scene, question)
    ]


#: properties of objects that require an effect; positions of objects require cameras
_CALLING = {
    Effect.SMOOTH_NORMALS: "normals at vertices",
    Effect.VERTEX_COLORS: "colors at vertices",
    Effect.TEXTURES: "a texture",
    Effect.AMBIENT: "a material with an ambient coefficient",
    Effect.DIFFUSE: "a material with a diffuse coefficient",
    Effect.SPECULAR: "a material with a specular coefficient",
    Effect.REFLECTION: "a reflective material",
}

_REFUSALS = {
    Refusal.NO_ENVIRONMENT: "there is no environment to reflect",
    Refusal.BLACK_ENVIRONMENT: "the environment is black",
    Refusal.NO_LIGHT: "there is no light",
}


def effect_reason(scene: Scene, decision: Decision, camera: Camera = Camera.BOTH) -> str:
    """Return the reason for the decision about an effect."""
    effect, inside, outside = decision.effect, len(decision.objects), len(decision.out_of_sight)
    if decision.refusal is not None:
        return _REFUSALS.get(decision.refusal, f"camera {camera} alone is asked for")
    if effect in CAMERAS:
        behind = effect is Effect.C
        heights = (0.0, scene.frustum.reach[behind])
        count = slab_content(scene, Camera(effect.value), heights).triangles
        subject = f"{counted(count, 'triangle')} {'lies' if count == 1 else 'lie'}"
        aside = ", and nothing of it lies in the frusta" if count and not inside else ""
        place = f"{'behind' if behind else 'before'} the plate within the reach"
        return f"{subject if count else 'nothing lies'} {place}{aside}"
    calling, count = _CALLING[effect], inside or outside
    if count == 0:
        return f"no object has {calling}"
    aside = "" if inside else ", beyond the reach or beside the frusta"
    return f"{counted(count, 'object')} {'has' if count == 1 else 'have'} {calling}{aside}"


def default_near(scene: Scene) -> float:
    """Return the default near offset."""
    return DEFAULT_NEAR_PER_REACH * scene.frustum.longest_reach


def depths(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> dict[str, Any]:
    """Return the content of an aperture's frustum by depth, with closed-form errors of each bin.

    The near offset displaces surfaces nearer than the first cut. A fit reduces the displacement; by
    default the first slab is fitted to its cut. The cameras of other slabs are in the aperture.
    """
    film, screen = np.array(scene.frustum.resolution), scene.frustum.screen
    corner_px, contrast = math.hypot(*film) / 2, band_limiting.contrast_of(scene, [aperture])
    fitted = settings.fitted_height(scene.frustum) if settings.slabs else None
    sheared_px = 0.0
    if screen is not None:
        # A shear of n per unit of depth moves the film by (W/2 kx/tx, H/2 ky/ty) pixels; k/t is
        # the distance from the aperture to the screen's middle, in half sizes of the screen.
        away = np.subtract(screen.center, (aperture.x, aperture.y)) / (np.array(screen.size) / 2)
        sheared_px = float(np.hypot(*(film / 2 * away)))
    rows: list[dict[str, Any]] = []
    nears, widest_blurs = list(settings.slabs), []
    for content in depth_bins(scene, [aperture]):
        of_fit = 1.0 if fitted is None else abs(1 - content.nearest / fitted)
        moved = 0.0
        sections = settings.sections(scene.frustum.reach[content.behind])
        if content.nearest < sections[0][1]:
            moved = settings.near / (content.nearest + settings.near)
            # corner of_fit n / (|z| + n) = tolerance, solved for n.
            rest = max(corner_px * of_fit - TOLERANCE_PX, TOLERANCE_PX)
            nears.append(content.nearest * TOLERANCE_PX / rest)
        widest, least = band_limiting.blurs(scene, content)
        widest_blurs.append(widest)
        rows.append(
            {
                "side": "behind" if content.behind else "before",
                "heights": content.heights,
                "nearest": content.nearest,
                "farthest": content.farthest,
                "triangles": content.triangles,
                "share": content.share,
                "near_px": corner_px * moved * of_fit,
                "shear_px": sheared_px * moved,
                "separation": _separation(content, sections, settings),
                "blur_px": (least, max(widest)),
                "sub_apertures": band_limiting.sub_apertures_for(widest, contrast),
            }
        )
    counts = [row["sub_apertures"] for row in rows]

    def levels(count: int) -> float:
        errors = (band_limiting.error_bound(count, blur, contrast) for blur in widest_blurs)
        return max(errors, default=0.0) / band_limiting.LEVEL

    return {
        "rows": rows,
        "near": settings.near,
        "largest_near": min(nears, default=0.0) or None,
        "tolerance_px": TOLERANCE_PX,
        "contrast": contrast,
        "sub_apertures": None if None in counts else max(filter(None, counts), default=1),
        "cuts": settings.slabs,
        "band_errors": [{"sub_apertures": n, "levels": levels(n)} for n in EXAMPLE_SUB_APERTURES],
    }


def _separation(content: DepthBin, sections: Sections, settings: DoubleFrustum) -> float:
    """Return the smallest resolved separation at a bin's farthest content, scene units."""
    low, high = next((ends for ends in sections if content.farthest <= ends[1]), sections[-1])
    # The camera of the first slab is offset; the cameras of other slabs are in the aperture.
    back, near = (settings.near, settings.near) if low == 0 else (0.0, low)
    w = np.array([content.farthest + back])
    separation = smallest_separation(w, near, high + back, settings.depth, settings.mapping)
    return float(separation[0])


def _points(count: int | None) -> str:
    return "over 65,536" if count is None else f"{count:,}"


def viewer_record(scene: Scene, distance: float, settings: DoubleFrustum) -> dict[str, Any]:
    """Return a display's limits for a viewer at a distance, and whether the viewer notices near.

    All surfaces within the reach count, even hidden surfaces; InputError if a surface is behind the
    viewer.
    """
    # Import late: measures of eyes load the ray tracers, which `check` without a viewer does not
    # need.
    from xfrustum.compare import noticeable  # noqa: PLC0415
    from xfrustum.compare.planning.requirement import (  # noqa: PLC0415
        CRACK,
        STEREO,
        ViewerRequirement,
        binding,
    )

    viewer, display = noticeable.Viewer(distance=distance), noticeable.Display.from_scene(scene)
    content = noticeable.surface_content(scene)
    noticeable.require_before_viewer(scene, content, viewer)
    requirement = ViewerRequirement(viewer=viewer, display=display, content=content)
    limits, noticed = requirement.limits(settings), requirement.noticed(settings)
    binds = binding(limits)
    return {
        "limits": noticeable.display_limits(scene, viewer),
        "near": settings.near,
        "near_limits": limits,
        "largest_unseen_near": math.inf if binds is None else binds.largest_near,
        "stereo_change_arcsec": noticed[STEREO][0] if STEREO in noticed else None,
        "crack_arcmin": noticed[CRACK][0] if CRACK in noticed else None,
        "seen": any(there > allowed for there, allowed, _ in noticed.values()),
        "bent": scene.frustum.recentered,
    }
