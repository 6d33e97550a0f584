"""A renderer on OpenGL, by a graphics card or in software: several moving surfaces, a floor, and pictures over it.

The extra ``film`` installs ModernGL. Rows of images run from top to bottom, because the projection is turned over.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Part
from engine_bridge.character.materials import Appearance
from engine_bridge.pictures import gpu_shaders as shaders
from engine_bridge.pictures.camera import Camera, orthographic
from engine_bridge.pictures.coarse import coarse_triangles
from engine_bridge.pictures.gpu_context import SOFTWARE, make_context
from engine_bridge.pictures.gpu_scene import Overlay, Panorama, StageExtent, Surroundings
from engine_bridge.pictures.renderer import CLAY

if TYPE_CHECKING:
    import moderngl

SAMPLES = 4
"""Samples per pixel for edges."""

SHADOW_SIZES, SKY_SIZE = (512, 1024, 2048), 128
"""Widths and heights of the depth maps of the key light, of which one is chosen, and of the sky, in texels."""

PENUMBRA_TEXELS = 3
"""Minimum radius in texels of the soft edge of the key light's shadow, if the largest map has it."""

OUTER_SAMPLES, KEY_SAMPLES, SKY_SAMPLES = 5, 6, 5
"""Samples of the depth maps per pixel: around it, and inside where these differ."""

PENUMBRA, SKY_PENUMBRA = 0.018, 0.09
"""Radii of the soft edges of the shadows of the key light and of the sky, as shares of `StageExtent.size`."""

SHADOW_CELL = 0.012
"""Width of the cells of the surface that casts shadows, as a share of its character's size; less than a penumbra."""

FINE_SHARE = 0.02
"""Side of triangles, as a share of their character's size, up to which light is computed at vertices."""

LIFT = 0.006
"""Distance off a surface from which light is looked up, as a share of `StageExtent.size`; nearer, it shades itself."""

FLOOR_REACH, FLOOR_TILE = 9.0, 1.6
"""Radius of the visible floor in radii of the stage, and width of its repeated picture in `StageExtent.size`."""

CLIP_DISTANCE = 0x3000
"""OpenGL's name of the plane at which surfaces are cut off, the floor."""


class DrawnPart(NamedTuple):
    """A part of a surface, on the graphics card."""

    material: Appearance
    program: "moderngl.Program"
    array: "moderngl.VertexArray"
    texture: "moderngl.Texture | None"


@dataclass
class Drawn:
    """A surface that moves, on the graphics card."""

    positions: "moderngl.Buffer"
    normals: "moderngl.Buffer"
    shadow: "moderngl.VertexArray"
    parts: list[DrawnPart] = field(default_factory=list)
    box: NDArray[np.float32] = field(default_factory=lambda: np.zeros((2, 3), np.float32))

    def move(self, positions: NDArray[np.float32], normals: NDArray[np.float32]) -> None:
        """Replace positions and unit normals (n, 3)."""
        self.positions.write(np.ascontiguousarray(positions, np.float32))
        self.normals.write(np.ascontiguousarray(normals, np.float32))
        axes = np.ascontiguousarray(positions.T)  # of which NumPy finds extremes 40 times as fast
        self.box = np.array([axes.min(axis=1), axes.max(axis=1)])


class GpuRenderer:
    """Draws frames of one size.

    Parameters
    ----------
    size : tuple of 2 ints
        Width and height, in pixels.
    samples : int
        Samples per pixel for edges.

    Attributes
    ----------
    device : str
        Name of the device that draws.

    Raises
    ------
    OutputError
        There is no graphics library.
    """

    def __init__(self, size: tuple[int, int], samples: int = SAMPLES) -> None:
        self.context = ctx = make_context()
        self.size = size
        self.device = str(ctx.info["GL_RENDERER"])
        samples = min(samples, ctx.max_samples) if samples > 1 else 0
        self._frame = ctx.framebuffer([ctx.renderbuffer(size, 4)])
        self._behind = ctx.framebuffer([ctx.renderbuffer(size, 4)])
        self._is_behind: tuple[object, ...] = ()
        self._shadows = ctx.texture((size[0] // 2, size[1] // 2), 4)
        self._shadows.repeat_x = self._shadows.repeat_y = False
        self._shade = ctx.framebuffer([self._shadows])
        # only surfaces have edges, so only where they are a pixel has several samples
        self._samples = ctx.texture(size, 4, samples=samples)
        self._target = ctx.framebuffer([self._samples], ctx.depth_renderbuffer(size, samples=samples))
        self._key_maps = {each: self._depth_map(each) for each in SHADOW_SIZES}
        self._sky_map = self._depth_map(SKY_SIZE)
        self._light = shaders.LIGHT
        for name in ("OUTER_SAMPLES", "KEY_SAMPLES", "SKY_SAMPLES"):
            self._light = self._light.replace(name, str(globals()[name]))
        self._shadow = ctx.program(shaders.SHADOW_VERTEX, shaders.SHADOW_FRAGMENT)
        self._surfaces: dict[tuple[bool, ...], moderngl.Program] = {}
        shadowed = shaders.FLOOR_SHADOW_FRAGMENT.replace("LIGHT\n", self._light)
        self._floor = ctx.program(shaders.FLOOR_VERTEX, shaders.FLOOR_FRAGMENT)
        self._floor_shadow = ctx.program(shaders.FLOOR_VERTEX, shadowed)
        self._panorama = ctx.program(shaders.PANORAMA_VERTEX, shaders.PANORAMA_FRAGMENT)
        self._picture = ctx.program(shaders.PICTURE_VERTEX, shaders.PICTURE_FRAGMENT)
        resolving = shaders.RESOLVE_FRAGMENT.replace("SAMPLER", "sampler2DMS" if samples else "sampler2D")
        self._resolve = ctx.program(shaders.PICTURE_VERTEX, resolving.replace("COUNT", str(max(samples, 1))))
        _set(self._resolve, "place", (0.0, 0.0, 1.0, 1.0))
        corners = ctx.buffer(np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]], np.float32))
        programs = self._floor, self._floor_shadow, self._panorama, self._picture, self._resolve
        self._quads = {program: ctx.vertex_array(program, [(corners, "2f", "corner")]) for program in programs}
        self._textures: dict[int, moderngl.Texture] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.context.release()

    @property
    def in_software(self) -> bool:
        """Whether no graphics card draws."""
        return self.device.startswith(SOFTWARE)

    def _depth_map(self, size: int) -> "tuple[moderngl.Texture, moderngl.Framebuffer]":
        depths = self.context.depth_texture((size, size))
        depths.compare_func = "<="
        depths.repeat_x = depths.repeat_y = False
        return depths, self.context.framebuffer(depth_attachment=depths)

    def add(self, parts: Sequence[Part], materials: Sequence[Appearance]) -> Drawn:
        """Add a character, whose vertices are those of its parts, one after another.

        Parameters
        ----------
        parts : sequence of Part
        materials : sequence of Appearance
            Of each part.
        """
        ctx, counts = self.context, [len(part.vertices) for part in parts]
        positions, normals = (ctx.buffer(reserve=12 * sum(counts), dynamic=True) for _ in range(2))
        starts = np.cumsum([0, *counts[:-1]])
        solid = [p.triangles + s for p, s, m in zip(parts, starts, materials, strict=True) if m.opacity != "BLEND"]
        everything = np.concatenate([part.vertices for part in parts])
        largest = float(np.ptp(everything, axis=0).max())
        casting = np.concatenate(solid or [np.zeros((0, 3), np.int64)])
        of_shadow = coarse_triangles(everything, casting, max(SHADOW_CELL * largest, 1e-12)).astype(np.uint32)
        drawn = Drawn(positions, normals, self._array(self._shadow, of_shadow, [(positions, "3f", "position")]))
        colors = [_vertex_colors(material) for material in materials]
        uv = ctx.buffer(np.concatenate([material.uv for material in materials]).astype(np.float32))
        tint = ctx.buffer(np.concatenate(colors).astype(np.float32))
        buffers = [
            (positions, "3f", "position"),
            (normals, "3f", "normal"),
            (tint, "4f", "vertex_color"),
            (uv, "2f", "uv"),
        ]
        for part, start, material in zip(parts, starts, materials, strict=True):
            fine = _triangle_size(part) <= FINE_SHARE * largest
            program = self._surface(fine, material)
            array = self._array(program, (part.triangles + start).astype(np.uint32), buffers)
            drawn.parts.append(DrawnPart(material, program, array, self._texture(material.image)))
        return drawn

    def _surface(self, fine: bool, material: Appearance) -> "moderngl.Program":
        """Return the program that draws a part.

        Light at vertices is computed once for all the small triangles around them. What is constant is not looked up,
        because software runs both sides of a condition, and a fragment that may be discarded even if it is hidden.
        """
        constants = {
            "BY_VERTEX": fine,
            "MASKED": material.opacity == "MASK",
            "BLENDED": material.opacity == "BLEND",
            "TEXTURED": material.image is not None,
            "TWO_SIDED": material.two_sided,
            "UNLIT": material.unlit,
        }
        key = tuple(constants.values())
        if key not in self._surfaces:
            defined = "".join(f"#define {name} {str(value).lower()}\n" for name, value in constants.items())
            texts = shaders.SURFACE_VERTEX, shaders.SURFACE_FRAGMENT
            vertex, fragment = (each.replace("LIGHT\n", defined + self._light) for each in texts)
            self._surfaces[key] = self.context.program(vertex, fragment)
        return self._surfaces[key]

    def _array(self, program: "moderngl.Program", faces: NDArray[np.uint32], buffers: list[Any]) -> Any:
        # ModernGL refuses an empty buffer; a triangle without area shows nothing
        faces = faces if len(faces) else np.zeros((1, 3), np.uint32)
        used = [each for each in buffers if each[2] in program]  # a compiler drops what does not count
        return self.context.vertex_array(program, used, self.context.buffer(np.ascontiguousarray(faces)))

    def _texture(self, image: NDArray[np.uint8] | None) -> "moderngl.Texture | None":
        if image is None:
            return None
        if id(image) not in self._textures:
            # sRGB, so that the hardware filters linear light
            texture = self.context.texture(image.shape[1::-1], 4, image.tobytes(), internal_format=0x8C43)
            texture.build_mipmaps()
            self._textures[id(image)] = texture
        return self._textures[id(image)]

    def picture(self, pixels: NDArray[np.uint8]) -> "moderngl.Texture":
        """Return an image (h, w, 4) for the background and overlays."""
        texture = self.context.texture(pixels.shape[1::-1], 4, np.ascontiguousarray(pixels).tobytes())
        texture.repeat_x = texture.repeat_y = False
        return texture

    def tile(self, pixels: NDArray[np.uint8]) -> "moderngl.Texture":
        """Return an image (h, w, 4) that repeats, for `Surroundings`."""
        import moderngl

        texture = self.context.texture(pixels.shape[1::-1], 4, np.ascontiguousarray(pixels).tobytes())
        texture.build_mipmaps()
        texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        return texture

    def draw(
        self,
        camera: Camera,
        stage: StageExtent,
        surfaces: Sequence[Drawn],
        around: Surroundings,
        overlays: Sequence[Overlay] = (),
    ) -> NDArray[np.uint8]:
        """Draw a frame.

        Parameters
        ----------
        camera : Camera
        stage : StageExtent
        surfaces : sequence of Drawn
        around : Surroundings
        overlays : sequence of Overlay

        Returns
        -------
        (height, width, 4) uint8
            sRGB; the fourth channel is undefined.
        """
        import moderngl

        ctx = self.context
        ctx.front_face = "cw"  # the projection turns pictures over
        boxes = np.array([each.box for each in surfaces]).reshape(-1, 2, 3)
        lighting = around.lighting
        towards = np.array(lighting.direction) / np.linalg.norm(lighting.direction)
        key = orthographic(towards, stage.center, stage.radius, stage.height)
        sky = orthographic(np.array([0.0, 1.0, 0.0]), stage.center, stage.radius, stage.height)
        texels = PENUMBRA_TEXELS * 2 * float(key.half.max()) / (PENUMBRA * stage.size)
        key_size = next((each for each in SHADOW_SIZES if each >= texels), SHADOW_SIZES[-1])
        depths, _ = key_map = self._key_maps[key_size]
        lights = ("key", key, PENUMBRA, key_map), ("sky", sky, SKY_PENUMBRA, self._sky_map)
        # what is behind the floor is hidden
        side = float(np.sign(camera.eye[1])) if around.has_floor else 0.0
        lift = LIFT * stage.size + 3 * float(key.half.max()) / depths.width
        matrix = camera.matrix(self.size)
        shared: dict[str, Any] = {"camera": matrix, "eye": camera.eye, "floor_side": side, "lift": lift}
        shared |= {"key_direction": towards, "key_color": lighting.key, "sky_color": lighting.sky}
        shared["ground_color"] = lighting.ground
        ctx.enable_only(moderngl.DEPTH_TEST)
        for number, (name, light, penumbra, (depths, target)) in enumerate(lights, 1):
            target.use()
            target.clear()
            _set(self._shadow, "light", light.matrix)
            for each in surfaces:
                each.shadow.render()
            depths.use(number)
            low, high = _extent(boxes, light.matrix) + np.array([[-1], [1]]) / depths.width
            shared |= {f"{name}_light": light.matrix, f"{name}_depths": number}
            shared[f"{name}_blur"] = penumbra * stage.size / (2 * light.half)
            shared[f"{name}_casters"] = (*(low + high) / 2, *(high - low) / 2)
        floor = {"middle": stage.center, "reach": FLOOR_REACH * stage.radius, "tile": FLOOR_TILE * stage.size}
        for program in (*self._surfaces.values(), self._floor, self._floor_shadow):
            for uniform, value in (shared | floor).items():
                _set(program, uniform, value)
        self._draw_around(camera, around, (matrix.tobytes(), stage, around))
        if surfaces and around.has_floor:
            self._draw_shadows(_shadows(boxes, towards, SKY_PENUMBRA * stage.size), matrix)
        if surfaces:
            self._draw_surfaces(surfaces, camera, _extent(boxes, matrix))
        for overlay in overlays:
            self._show(overlay)
        pixels = np.frombuffer(self._frame.read(components=4), np.uint8)
        return pixels.reshape(self.size[1], self.size[0], 4)

    def _draw_around(self, camera: Camera, around: Surroundings, seen: tuple[object, ...]) -> None:
        """Draw the background and the floor, or copy them from before if the camera has not moved."""
        import moderngl

        if self._is_behind != seen:
            self._is_behind = seen
            self._behind.use()
            self.context.enable_only(moderngl.BLEND)
            if isinstance(around.background, Panorama):
                self._show_panorama(camera, around.background)
            else:
                self._show(Overlay(around.background))
            if around.has_floor and around.floor is not None:
                around.floor.use(0)
                _set(self._floor, "image", 0)
                self._quads[self._floor].render(moderngl.TRIANGLE_STRIP)
        self.context.copy_framebuffer(self._frame, self._behind)
        self._frame.use()

    def _show_panorama(self, camera: Camera, panorama: Panorama) -> None:
        import moderngl

        right, up, towards = camera.axes
        slope = np.tan(np.radians(camera.field_of_view) / 2)
        panorama.image.use(0)
        values = {
            "right": right * slope * self.size[0] / self.size[1],
            "up": up * slope,
            "ahead": -towards,
            "image": 0,
            "period": np.radians(panorama.period),
            "elevations": np.radians([panorama.top, panorama.bottom]),
        }
        for name, value in values.items():
            _set(self._panorama, name, value)
        self._quads[self._panorama].render(moderngl.TRIANGLE_STRIP)

    def _draw_shadows(self, boxes: NDArray[np.float32], matrix: NDArray[np.float32]) -> None:
        """Darken the floor in boxes (n, 2, 3) on it, at half the resolution, because shadows are soft."""
        import moderngl

        ctx: Any = self.context
        extent = _extent(boxes, matrix)
        ctx.enable_only(0)
        self._shade.use()
        self._shade.clear(1.0, 1.0, 1.0, 1.0)
        with self._within(self._shade, extent):
            self._quads[self._floor_shadow].render(moderngl.TRIANGLE_STRIP)
        self._frame.use()
        ctx.enable_only(moderngl.BLEND)
        ctx.blend_func = moderngl.ZERO, moderngl.SRC_COLOR
        with self._within(self._frame, extent):
            self._show(Overlay(self._shadows))
        ctx.blend_func = moderngl.DEFAULT_BLENDING

    @contextmanager
    def _within(self, frame: "moderngl.Framebuffer", extent: NDArray[np.float32]) -> Iterator[None]:
        """Draw between two corners (2, 2) only, in shares of a frame."""
        low, high = np.clip([np.floor(extent[0] * frame.size), np.ceil(extent[1] * frame.size)], 0, frame.size).astype(
            int
        )
        scissored: Any = frame
        scissored.scissor = (*low.tolist(), *(high - low).tolist())
        yield
        scissored.scissor = None

    def _draw_surfaces(self, surfaces: Sequence[Drawn], camera: Camera, extent: NDArray[np.float32]) -> None:
        """Draw surfaces over the frame, between two corners (2, 2) in shares of it."""
        import moderngl

        ctx: Any = self.context
        ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA  # opacity is in the colours already
        with self._within(self._target, extent):
            self._target.use()
            self._target.clear()
            ctx.enable_direct(CLIP_DISTANCE)
            for part in _in_order(surfaces, camera):
                self._show_part(part)
            ctx.disable_direct(CLIP_DISTANCE)
        with self._within(self._frame, extent):
            self._frame.use()
            ctx.enable_only(moderngl.BLEND)
            self._samples.use(0)
            self._quads[self._resolve].render(moderngl.TRIANGLE_STRIP)
        ctx.blend_func = moderngl.DEFAULT_BLENDING

    def _show_part(self, part: DrawnPart) -> None:
        import moderngl

        material = part.material
        if part.texture is not None:
            part.texture.use(0)
        _set(part.program, "image", 0)
        _set(part.program, "color", (*CLAY, 1.0) if material.plain else material.color)
        _set(part.program, "cutoff", material.cutoff)
        self.context.enable_only(
            moderngl.DEPTH_TEST
            | (moderngl.BLEND if material.opacity == "BLEND" else 0)
            | (0 if material.two_sided else moderngl.CULL_FACE)
        )
        part.array.render()

    def _show(self, overlay: Overlay) -> None:
        import moderngl

        overlay.picture.use(0)
        _set(self._picture, "image", 0)
        _set(self._picture, "opacity", overlay.opacity)
        _set(self._picture, "place", overlay.place)
        self._quads[self._picture].render(moderngl.TRIANGLE_STRIP)


def _vertex_colors(material: Appearance) -> NDArray[np.float32]:
    colors = material.vertex_colors
    colors = np.ones((len(material.uv), 4), np.float32) if colors is None else colors
    if material.opacity == "OPAQUE":  # glTF: opacity is ignored
        return colors * np.array([1, 1, 1, 0], np.float32) + np.array([0, 0, 0, 1], np.float32)
    return colors


def _triangle_size(part: Part) -> float:
    """Return the length of the sides of triangles of mean area."""
    a, b, c = np.moveaxis(part.vertices[part.triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return float(np.sqrt(2 * areas.mean())) if len(areas) else 0.0


def _set(program: "moderngl.Program", name: str, value: Any) -> None:
    """Set a uniform, unless the compiler has dropped it because it does not count."""
    if name not in program:
        return
    uniform: Any = program[name]
    if isinstance(value, np.ndarray) and value.ndim == 2:
        uniform.write(value)
    else:
        uniform.value = value if np.ndim(value) == 0 else tuple(map(float, value))


def _extent(boxes: NDArray[np.float32], matrix: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the corners (2, 2) of the rectangle that boxes (n, 2, 3) cover in a projection, in shares of its image."""
    if not len(boxes):
        return np.full((2, 2), -9, np.float32)
    corners = np.concatenate([np.where(bits, boxes[:, 1], boxes[:, 0]) for bits in product((False, True), repeat=3)])
    places = np.pad(corners, ((0, 0), (0, 1)), constant_values=1) @ matrix
    if (places[:, 3] <= 0).any():  # beside or behind the camera
        return np.array([[0, 0], [1, 1]], np.float32)
    shares = 0.5 + 0.5 * places[:, :2] / places[:, 3:]
    return np.array([shares.min(axis=0), shares.max(axis=0)])


def _shadows(boxes: NDArray[np.float32], towards: NDArray[np.float64], blur: float) -> NDArray[np.float32]:
    """Return boxes (n, 2, 3) around the shadows of boxes on the floor, of a light and of the sky above."""
    ways = boxes[:, 1, 1, None] * (towards / towards[1])
    low = np.minimum(boxes[:, 0], boxes[:, 0] - ways) - blur
    high = np.maximum(boxes[:, 1], boxes[:, 1] - ways) + blur
    shadows: NDArray[np.float32] = np.stack([low, high], axis=1) * [1, 0, 1]
    return shadows


def _in_order(surfaces: Sequence[Drawn], camera: Camera) -> Iterator[DrawnPart]:
    """Yield what is opaque, the nearest surface first, and then what is transparent, the farthest first."""
    near = sorted(surfaces, key=lambda each: float(np.linalg.norm(each.box.mean(axis=0) - camera.eye)))
    yield from (part for each in near for part in each.parts if part.material.opacity != "BLEND")
    yield from (part for each in reversed(near) for part in each.parts if part.material.opacity == "BLEND")
