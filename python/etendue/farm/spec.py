"""What a user orders: `JobSpec`, checked as a whole before anything is done."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

import etendue

MAX_RUNS = 1000
"""Most runs of a study."""
MAX_FRAMES = 100_000
"""Most frames of a job."""

Setting = bool | int | float | str
Format = Literal["exr", "png", "jpg", "hdr", "pfm", "film", "glb", "photons"]
Command = Literal["render", "study", "bake", "photons"]
FORMATS: dict[Command, tuple[Format, ...]] = {
    "render": ("exr", "png", "jpg", "hdr", "pfm", "film"),
    "study": ("exr", "png", "jpg", "hdr", "pfm", "film"),
    "bake": ("glb",),
    "photons": ("photons",),
}
"""What commands make; where the order does not say, the first."""
_RANGE = re.compile(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*(?:x\s*(\d{1,6})\s*)?)?")


@lru_cache(maxsize=256)
def parse_frames(text: str) -> tuple[int, ...]:
    """Return the numbers of a list of frames, each once, in order: `1-48`, `1-100x5` (every fifth), `1,4,10-12`.

    Raises:
        ValueError: It is no such list, is empty, or has more than `MAX_FRAMES` frames.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        match = _RANGE.fullmatch(part)
        if match is None:
            raise ValueError(f"`{part.strip()[:40]}` is no frame or range of frames; write 1-48, 1-100x5 or 1,4,10-12")
        first = int(match[1])
        last = int(match[2] or first)
        step = int(match[3] or 1)
        if last < first or step == 0:
            raise ValueError(f"the range of frames `{part.strip()}` is empty")
        if (last - first) // step + 1 > MAX_FRAMES:
            raise ValueError(f"a job has at most {MAX_FRAMES} frames")
        numbers.update(range(first, last + 1, step))
        if len(numbers) > MAX_FRAMES:
            raise ValueError(f"a job has at most {MAX_FRAMES} frames")
    return tuple(sorted(numbers))


@lru_cache(maxsize=256)
def _every(text: str, step: int) -> frozenset[int]:
    return frozenset(parse_frames(text)[::step])


class StopRules(BaseModel):
    """When a frame or job has enough samples, beside `settings["spp"]`. Whatever comes first.

    Rules are looked at after whole rounds of samples, so the picture of a frame is that of `etendue render --spp N` with the N that the
    frame tells.
    """

    model_config = ConfigDict(extra="forbid")

    noise: Annotated[float, Field(gt=0, le=10)] | None = None
    """Relative error of each frame, as of `etendue render --noise`."""
    secs: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """Wall time of the job since its first unit, in seconds; it then ends with what it has."""
    core_secs: Annotated[float, Field(gt=0, le=1e12)] | None = None
    """Core-seconds of the job; it then ends with what it has."""
    cost: Annotated[float, Field(gt=0, le=1e12)] | None = None
    """Cost of the job in the farm's currency; it then ends with what it has."""

    @property
    def is_open(self) -> bool:
        """Whether any rule is given: then samples come in rounds."""
        return any(rule is not None for rule in (self.noise, self.secs, self.core_secs, self.cost))


class BakeSpec(BaseModel):
    """How a scene is baked: the flags of `etendue bake`."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True)

    method: Literal["path", "radiosity", "particles"] = "path"
    """How light is found."""
    final_gather: bool = False
    """Looks up radiosity and particles not at the texel but where rays from it arrive."""
    texels_per_meter: Annotated[float, Field(gt=0, lt=1e9)] | None = None
    """Texels for a unit of length; None: as many as fit into one atlas."""
    resolution: Annotated[int, Field(ge=16, le=16384)] = 1024
    """Largest edge of an atlas in texels."""
    padding: Annotated[int, Field(ge=1, le=32)] = 2
    """Gutter around each chart in texels."""
    unwrap: bool = False
    """New texture coordinates even where the file's second set is usable."""
    sides: Literal["auto", "front", "both"] = "auto"
    """Which sides of two-sided surfaces get light."""
    per_vertex: bool = False
    """Light in the colors of the vertices instead of textures."""
    display: Literal["emissive", "unlit", "lightmap"] = "emissive"
    """How the light is shown."""
    exr: bool = False
    """Also irradiance, albedo and normals of each atlas as EXR."""
    directional: bool = False
    """In those also the direction from which most light comes."""
    probes: (
        tuple[Annotated[int, Field(ge=1, le=1024)], Annotated[int, Field(ge=1, le=1024)], Annotated[int, Field(ge=1, le=1024)]] | None
    ) = None
    """Also measure light in the air, on a grid of so many points, as spherical harmonics in JSON."""
    denoise: bool = False
    """Removes noise with Intel Open Image Denoise, where workers have it."""

    def preparation(self) -> dict[str, object]:
        """Return what workers need to know before the first sample."""
        later = {"display", "exr", "directional", "probes", "denoise"}
        return {key: value for key, value in self.model_dump().items() if key not in later}


class JobSpec(BaseModel):
    """An order. Everything but `package` has a default."""

    model_config = ConfigDict(extra="forbid")

    package: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """Name of an uploaded package."""
    scene: Annotated[str, Field(max_length=1024)] | None = None
    """Scene file within the package; None: the package's own."""
    name: Annotated[str, Field(max_length=256)] = ""
    """What the list of jobs shows; empty: the scene's name."""
    command: Command = "render"
    """What to do: `render` a still or an animation; a `study`, several pictures of one scene; `bake` the scene's light into it; trace the
    `photons` of a map."""
    bake: BakeSpec = Field(default_factory=BakeSpec)
    """Of a bake: how. Its samples are `settings["spp"]`, and what a method asks for is in `settings` as well."""
    settings: dict[str, Setting | None] = Field(default_factory=dict)
    """Settings of the renderer: the keywords of `etendue.Scene.render`, see `etendue.parameters()`."""
    crop: tuple[int, int, int, int] | None = None
    """Only these pixels: x0, y0, x1, y1."""
    aovs: Annotated[list[str], Field(max_length=32)] = Field(default_factory=list)
    """Auxiliary outputs, as of `etendue.Scene.render`."""
    defines: Annotated[dict[str, Setting], Field(max_length=256)] = Field(default_factory=dict)
    """Values for `$key` in a Mitsuba file or of identifiers in a POV-Ray scene."""
    variant: str | None = None
    """Material variant of a glTF file."""
    gltf_scene: str | None = None
    """Scene of a glTF file."""
    gltf_animation: str | None = None
    """Animation of a glTF file, by name or number; None: the first."""
    frames: Annotated[str, Field(max_length=10_000)] | None = None
    """Frames of an animation, such as `1-48`, `1-100x5`, `1,4,10-12`; None: a still."""
    runs: Annotated[list[dict[str, Setting | None]], Field(max_length=MAX_RUNS)] = Field(default_factory=list)
    """Of a study: what each of its pictures has beside, or instead of, `settings`; the first is number 1."""
    last_frame: Annotated[int, Field(ge=1, le=1_000_000_000)] | None = None
    """Number of the animation's last frame, where `frames` does not go up to it: the clock depends on it."""
    clocks: tuple[float, float] = (0.0, 1.0)
    """`clock` of frame 1 and of the last frame, which is a second of a glTF file's animation; a still has the first. A still with clock 0
    shows a glTF file's pose without animation."""
    formats: Annotated[list[Format], Field(max_length=6)] = Field(default_factory=list)
    """Files to make of each frame; none: those of `FORMATS`."""
    exposure: Annotated[float, Field(ge=-64, le=64)] = 0.0
    """Of PNG and JPEG files, in stops."""
    tonemap: str = "standard"
    """Of PNG and JPEG files."""
    stop: StopRules = Field(default_factory=StopRules)
    every_first: Annotated[int, Field(ge=2, le=MAX_FRAMES)] | None = None
    """Render every so-manieth frame first."""
    approval: bool = False
    """After those, wait until someone approves."""
    priority: Annotated[int, Field(ge=-100, le=100)] = 0
    """Jobs of higher priority go first."""
    shared: bool = False
    """Whether all users of the farm may look at it."""
    needs: Annotated[list[int], Field(max_length=1000)] = Field(default_factory=list)
    """Jobs that have to be done before."""
    notify: Annotated[str, Field(max_length=2000)] | None = None
    """URL that gets a POST with the job as JSON when it ends or waits for approval."""
    unit_secs: Annotated[float, Field(ge=0.05, le=3600)] | None = None
    """Length of a unit on one worker; None: the farm's choice, 10 to 60."""
    max_attempts: Annotated[int, Field(ge=1, le=20)] = 3
    """How often a unit may fail before its frame does. Units that are lost with their node do not count."""

    @field_validator("name", "tonemap", "scene", "variant", "gltf_scene", "gltf_animation")
    @classmethod
    def _is_printable(cls, text: str | None) -> str | None:
        if text is not None and any(ord(c) < 32 or ord(c) == 127 for c in text):
            raise ValueError("has control characters")
        return text

    @field_validator("frames")
    @classmethod
    def _is_list_of_frames(cls, text: str | None) -> str | None:
        if text is not None and not parse_frames(text):
            raise ValueError("there are no frames")
        return text

    @field_validator("notify")
    @classmethod
    def _is_web_address(cls, url: str | None) -> str | None:
        if url is not None and (urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname):
            raise ValueError("takes an http:// or https:// address")
        return url

    @field_validator("settings")
    @classmethod
    def _are_settings(cls, settings: dict[str, Setting | None]) -> dict[str, Setting | None]:
        known = {p.name for p in etendue.parameters()}
        unknown = sorted(set(settings) - known)
        if unknown:
            raise ValueError(f"there is no setting `{unknown[0][:64]}`; there are {', '.join(sorted(known))}")
        return {key: value for key, value in settings.items() if value is not None}

    @field_validator("runs")
    @classmethod
    def _are_runs(cls, runs: list[dict[str, Setting | None]]) -> list[dict[str, Setting | None]]:
        return [cls._are_settings(run) for run in runs]

    @model_validator(mode="after")
    def _fits_together(self) -> JobSpec:
        self.formats = self.formats or [FORMATS[self.command][0]]
        wrong = [kind for kind in self.formats if kind not in FORMATS[self.command]]
        if wrong:
            raise ValueError(f"a `{self.command}` makes {', '.join(FORMATS[self.command])}, not {wrong[0]}")
        if self.command in ("bake", "photons"):
            given = [name for name, value in (("frames", self.frames), ("crop", self.crop), ("aovs", self.aovs)) if value]
            given += [f"stop.{name}" for name, value in self.stop if value is not None]
            if given:
                raise ValueError(f"`{given[0]}` is for pictures; a `{self.command}` has a number of samples or photons")
        elif self.bake != BakeSpec():
            raise ValueError("`bake` is for the command `bake`")
        if (self.command == "study") != bool(self.runs):
            raise ValueError("a `study` has `runs`, and nothing else has")
        if self.command == "study" and self.frames is not None:
            raise ValueError("a `study` has `runs` in place of `frames`")
        if self.every_first is not None and self.frames is None:
            raise ValueError("`every_first` is for animations")
        if self.approval and self.every_first is None:
            raise ValueError("`approval` needs `every_first`")
        if self.last_frame is not None and self.frames is not None and self.last_frame < parse_frames(self.frames)[-1]:
            raise ValueError("`last_frame` is before the last of `frames`")
        return self

    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the frames, or of a study's runs; (0,) for a still."""
        if self.runs:
            return tuple(range(1, len(self.runs) + 1))
        return parse_frames(self.frames) if self.frames is not None else (0,)

    def last_number(self) -> int:
        """Return the number of the frame whose units come last."""
        numbers = self.numbers()
        first = self.first_numbers()
        return next((n for n in reversed(numbers) if n not in first), numbers[-1])

    def final(self) -> int:
        """Return the number of the animation's last frame; 0 for stills and studies."""
        return 0 if self.frames is None else self.last_frame or self.numbers()[-1]

    def clock(self, number: int) -> float:
        """Return `clock` of a frame: from the first value at frame 1 to the second at the last frame."""
        return self.clock_of([number])[0]

    def clock_of(self, numbers: Iterable[int]) -> list[float]:
        """Return `clock` of each of some frames."""
        first, last = self.clocks
        final = self.final()
        return [first if final <= 1 else first + (last - first) * ((n - 1) / (final - 1)) for n in numbers]

    def settings_of(self, number: int) -> dict[str, Setting | None]:
        """Return the settings of a frame, or of a study's run."""
        return {**self.settings, **self.runs[number - 1]} if self.runs else self.settings

    def first_numbers(self) -> frozenset[int]:
        """Return the frames that come first and need no approval."""
        return frozenset(self.numbers()) if self.frames is None else _every(self.frames, self.every_first or 1)
