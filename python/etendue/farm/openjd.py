"""Open Job Description templates (https://github.com/OpenJobDescription): what other farms and submitters read and write.

A job is exported as a template whose step runs `etendue render` once for each frame or run: any scheduler of such templates can do it. On
import, steps that run `etendue render` become jobs, their parameter spaces frames of an animation or runs of a study. A farm runs no other
programs: templates with scripts, environments or other commands are refused by name.
"""

from __future__ import annotations

import argparse
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import etendue
from etendue.farm.errors import InvalidError, NotFoundError
from etendue.farm.spec import MAX_FRAMES, MAX_RUNS, JobSpec, Setting

VERSION = "jobtemplate-2023-09"
MAX_TEXT = 1 << 20
"""Most bytes of a template."""
MAX_VALUES = 1024
"""Most values of a parameter, as the specification says."""
_PLACE = re.compile(r"\{\{\s*((?:Task\.)?(?:Raw)?Param\.[A-Za-z_][A-Za-z0-9_]*)\s*\}\}")
_FORMATS = ("exr", "png", "jpg", "hdr", "pfm", "film")


@dataclass
class Imported:
    """A step of a template, as the farm does it."""

    step: str
    scene: Path
    """The scene file, on this machine."""
    order: dict[str, Any]
    """A `JobSpec` without its package."""
    needs: list[str] = field(default_factory=list)
    """Steps that have to be done before."""


# ---- export ----


def export_job(spec: JobSpec, scene: str, name: str) -> dict[str, Any]:
    """Return a job as a template. Its parameters are the scene's path and the folder for pictures.

    Args:
        spec: The order.
        scene: The scene file within its package.
        name: Name of the job.

    Raises:
        InvalidError: The job has what a template cannot say, such as stopping at a cost.
    """
    if spec.command in ("bake", "photons"):
        raise InvalidError(f"a template renders pictures; a `{spec.command}` cannot be exported")
    lost = [rule for rule in ("secs", "core_secs", "cost") if getattr(spec.stop, rule) is not None]
    lost += [rule for rule in ("every_first", "approval", "crop") if getattr(spec, rule)]
    if lost:
        raise InvalidError(f"a template cannot say `{lost[0]}` as the farm means it; submit the job without it")
    if len(spec.numbers()) > MAX_VALUES:
        raise InvalidError(f"a template has at most {MAX_VALUES} values of a parameter; submit fewer frames at a time")
    spaces: list[dict[str, Any]] = []
    args = ["render", "{{Param.Scene}}"]
    stem = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "picture"
    number = ""
    if spec.frames is not None:
        numbers = spec.numbers()
        spaces.append({"name": "Frame", "type": "INT", "range": _range(numbers)})
        # As text, so that each clock is the number that the farm has.
        spaces.append({"name": "Clock", "type": "STRING", "range": [repr(clock) for clock in spec.clock_of(numbers)]})
        args += ["--frame", "{{Task.Param.Frame}}", "--frames", str(spec.final()), "--clock", "{{Task.Param.Clock}}"]
        number = ".{{Task.Param.Frame}}"
    settings: dict[str, Setting | None] = dict(spec.settings)
    if spec.runs:
        names = list(dict.fromkeys(key for run in spec.runs for key in run))
        if any(set(run) != set(names) for run in spec.runs):
            raise InvalidError("a template has all of its parameters in each task; give every run the same settings")
        for key in names:
            settings.pop(key, None)
            values = [_text(run[key]) for run in spec.runs]
            spaces.append({"name": _parameter(key), "type": "STRING", "range": values})
            args += [_flag(key), f"{{{{Task.Param.{_parameter(key)}}}}}"]
            number += f".{{{{Task.Param.{_parameter(key)}}}}}"
    for key, value in sorted(settings.items()):
        args += [_flag(key), _text(value)]
    for key, value in sorted(spec.defines.items()):
        args += ["-D", f"{key}={_text(value)}"]
    for flag, text in (("--variant", spec.variant), ("--gltf-scene", spec.gltf_scene), ("--gltf-animation", spec.gltf_animation)):
        args += [flag, text] if text is not None else []
    args += ["--noise", f"{spec.stop.noise:g}"] if spec.stop.noise is not None else []
    args += ["--aov", ",".join(spec.aovs)] if spec.aovs else []
    args += ["--exposure", f"{spec.exposure:g}"] if spec.exposure else []
    args += ["--tonemap", spec.tonemap] if spec.tonemap != "standard" else []
    for kind in dict.fromkeys(spec.formats):
        args += ["-o", f"{{{{Param.Output}}}}/{stem}{number}.{kind}"]
    step: dict[str, Any] = {"name": "Render", "script": {"actions": {"onRun": {"command": "etendue", "args": args}}}}
    if spaces:
        step["parameterSpace"] = {"taskParameterDefinitions": spaces}
        if len(spaces) > 1:
            # One after the other, not all combinations.
            step["parameterSpace"]["combination"] = "(" + ", ".join(s["name"] for s in spaces) + ")"
    clean = "".join(c for c in name if c.isprintable())[:128]
    template = {
        "specificationVersion": VERSION,
        "name": clean.replace("{{", "{ {") or "Etendue",
        "parameterDefinitions": [
            {"name": "Scene", "type": "PATH", "objectType": "FILE", "dataFlow": "IN", "default": scene},
            {"name": "Output", "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "OUT", "default": "pictures"},
        ],
        "steps": [step],
    }
    _model().decode_job_template(template=template)
    return template


def _range(numbers: Sequence[int]) -> str:
    """Return rising numbers as a range expression of OpenJD: `1-48`, `1-100:5`, `1,4,10-12`."""
    parts: list[str] = []
    i = 0
    while i < len(numbers):
        step = numbers[i + 1] - numbers[i] if i + 1 < len(numbers) else 1
        end = i + 1
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        # Two that are not neighbors are no range.
        end = i + 1 if step > 1 and end - i < 3 else end
        first, last = numbers[i], numbers[end - 1]
        parts.append(str(first) if first == last else f"{first}-{last}" + (f":{step}" if step > 1 else ""))
        i = end
    return ",".join(parts)


def _parameter(key: str) -> str:
    return "".join(word.capitalize() for word in key.split("_"))


def _flag(key: str) -> str:
    return "--" + key.replace("_", "-")


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


# ---- import ----


def import_template(path: Path, values: Mapping[str, str]) -> list[Imported]:
    """Return the jobs of a template, YAML or JSON, in an order in which each comes after those that it needs.

    Args:
        path: The template. Paths in it are relative to its folder.
        values: Values of the template's parameters.

    Raises:
        InvalidError: It is no template, or asks for what a farm does not do; the message says what and where.
        NotFoundError: A scene is not there.
    """
    model = _model()
    if path.stat().st_size > MAX_TEXT:
        raise InvalidError(f"{path}: a template has at most {MAX_TEXT} bytes")
    kind = model.DocumentType.JSON if path.suffix.lower() == ".json" else model.DocumentType.YAML
    folder = path.resolve().parent
    try:
        document = model.document_string_to_object(document=path.read_text(encoding="utf-8"), document_type=kind)
        template = model.decode_job_template(template=document)
        given = model.preprocess_job_parameters(
            job_template=template,
            job_parameter_values=dict(values),
            job_template_dir=folder,
            current_working_dir=Path.cwd(),
            allow_job_template_dir_walk_up=True,
        )
        job = model.create_job(job_template=template, job_parameter_values=given)
    except (model.DecodeValidationError, ValueError, RuntimeError, UnicodeDecodeError) as e:
        raise InvalidError(f"{path}: {str(e)[:4000]}") from e
    if job.jobEnvironments:
        raise InvalidError(f"{path}: the job has environments; a farm runs `etendue render` and nothing around it")
    known = {f"{raw}Param.{name}": str(p.value) for name, p in (job.parameters or {}).items() for raw in ("", "Raw")}
    waiting = {step.name: _step(model, step, job.name, known, is_one_of_many=len(job.steps) > 1) for step in job.steps}
    ordered: list[Imported] = []
    done: set[str] = set()
    while waiting:
        # The model has refused circles.
        name = next(n for n, step in waiting.items() if done.issuperset(step.needs))
        ordered.append(waiting.pop(name))
        done.add(name)
    return ordered


def _step(
    model: Any,  # noqa: ANN401 - classes of the optional package
    step: Any,  # noqa: ANN401
    job_name: str,
    known: Mapping[str, str],
    *,
    is_one_of_many: bool,
) -> Imported:
    def fault(text: str) -> InvalidError:
        return InvalidError(f"step `{step.name}`: {text}")

    if step.stepEnvironments or step.script.embeddedFiles:
        raise fault("has environments or embedded files; a farm runs `etendue render` and nothing around it")
    run = step.script.actions.onRun
    command, arguments = str(run.command), [str(a) for a in run.args or []]
    if Path(command).name not in ("etendue", "etendue.exe") or arguments[:1] != ["render"]:
        raise fault(f"runs `{command[:80]} {' '.join(arguments[:1])[:80]}`; a farm runs `etendue render` alone")
    tasks: list[dict[str, str]] = [{}]
    if step.parameterSpace is not None:
        found = itertools.islice(model.StepParameterSpaceIterator(space=step.parameterSpace), MAX_FRAMES + 1)
        tasks = [{f"Task.{raw}Param.{name}": str(v.value) for name, v in task.items() for raw in ("", "Raw")} for task in found]
        if len(tasks) > MAX_FRAMES:
            raise fault(f"has more than {MAX_FRAMES} tasks")
    read = [_arguments([_put(a, {**known, **task}) for a in arguments[1:]], fault) for task in tasks]
    first, settings = read[0], [_settings(args) for args in read]
    same = {key for key in vars(first) if key not in ("frame", "clock", "output", *(f"set_{p.name}" for p in etendue.parameters()))}
    if any(getattr(args, key) != getattr(first, key) for args in read for key in same):
        raise fault("has tasks of different scenes or options; frames and settings of the renderer may differ")
    numbers = [args.frame for args in read]
    order: dict[str, Any] = {
        "name": f"{job_name} – {step.name}" if is_one_of_many else job_name,
        "settings": settings[0],
        "defines": dict(first.define),
        "variant": first.variant,
        "gltf_scene": first.gltf_scene,
        "gltf_animation": first.gltf_animation,
        "aovs": [name for names in first.aov for name in names.split(",") if name],
        "exposure": first.exposure,
        "tonemap": first.tonemap,
        "stop": {"noise": first.noise},
        "formats": _formats(args.output for args in read) or ["exr"],
    }
    if any(value != settings[0] for value in settings):
        if set(numbers) != {0}:
            raise fault("has frames and settings that differ; make a step for each setting")
        if len(settings) > MAX_RUNS:
            raise fault(f"has more than {MAX_RUNS} runs")
        shared = {key: value for key, value in settings[0].items() if all(s.get(key) == value for s in settings)}
        runs = [{key: value for key, value in s.items() if key not in shared} for s in settings]
        order |= {"command": "study", "settings": shared, "runs": runs}
    elif set(numbers) != {0}:
        order |= _frames(read, fault)
    elif len(tasks) > 1:
        raise fault("has tasks that do not differ")
    scene = Path(first.scene)
    if not scene.is_file():
        raise NotFoundError(f"step `{step.name}`: there is no scene {scene}")
    return Imported(step.name, scene, order, [d.dependsOn for d in step.dependencies or []])


def _frames(read: Sequence[argparse.Namespace], fault: Any) -> dict[str, Any]:  # noqa: ANN401
    numbers = sorted(args.frame for args in read)
    final = read[0].frames or numbers[-1]
    if len(set(numbers)) != len(numbers) or numbers[0] < 1:
        raise fault("has a frame twice, or one before frame 1")
    order = {"frames": _range(numbers).replace(":", "x"), "last_frame": final}
    clocks = {args.frame: args.clock for args in read}
    # The farm's clock goes evenly from frame 1 to the last: mostly from 0 to 1, else as the first and the last of these tell.
    first, last = clocks[numbers[0]], clocks[numbers[-1]]
    slope = (last - first) / (numbers[-1] - numbers[0]) if len(numbers) > 1 else 0.0
    start = first - slope * (numbers[0] - 1)
    for ends in ((0.0, 1.0), (start, start + slope * (final - 1))):
        wanted = JobSpec.model_validate({"package": "0" * 64, **order, "clocks": ends}).clock_of(numbers)
        if all(abs(clocks[n] - w) <= 1e-9 * max(1.0, abs(w)) for n, w in zip(numbers, wanted, strict=True)):
            return {**order, "clocks": ends}
    raise fault("has a clock that does not go evenly from frame to frame")


def _put(text: str, values: Mapping[str, str]) -> str:
    return _PLACE.sub(lambda match: values.get(match[1], match[0]), text)


def _formats(outputs: Iterable[Sequence[str]]) -> list[str]:
    endings = [Path(path).suffix.lower().lstrip(".") for paths in outputs for path in paths]
    return list(dict.fromkeys("jpg" if e == "jpeg" else e for e in endings if e in (*_FORMATS, "jpeg")))


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> Any:  # noqa: ANN401 - it does not return
        raise InvalidError(message)


def _arguments(argv: Sequence[str], fault: Any) -> argparse.Namespace:  # noqa: ANN401
    parser = _Parser(prog="etendue render", add_help=False, allow_abbrev=False, exit_on_error=False)
    add = parser.add_argument
    add("scene")
    add("-o", "--output", action="append", default=[])
    add("-D", "--define", action="append", default=[], type=_pair)
    for name in ("--variant", "--gltf-scene", "--gltf-animation"):
        add(name)
    add("--aov", action="append", default=[])
    add("--frame", type=int, default=0)
    add("--frames", type=int, default=0)
    add("--clock", type=float, default=0.0)
    add("--noise", type=float)
    add("--exposure", type=float, default=0.0)
    add("--tonemap", default="standard")
    add("-q", "--quiet", action="store_true")
    for parameter in etendue.parameters():
        if _flag(parameter.name) not in parser._option_string_actions:
            add(_flag(parameter.name), dest=f"set_{parameter.name}")
    try:
        return parser.parse_args(list(argv))
    except (InvalidError, argparse.ArgumentError) as e:
        raise fault(f"`etendue render` on a farm: {e}") from e


def _pair(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise argparse.ArgumentTypeError("expected KEY=VALUE")
    return key, value


def setting(text: str) -> Setting:
    """Return a value of the command line as what it looks like."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _settings(args: argparse.Namespace) -> dict[str, Setting]:
    found = {p.name: getattr(args, f"set_{p.name}", None) for p in etendue.parameters()}
    return {key: setting(value) for key, value in found.items() if value is not None}


def _model() -> Any:  # noqa: ANN401 - a module
    try:
        import openjd.model
    except ModuleNotFoundError as e:
        raise InvalidError('templates need the Python package `openjd-model`: pip install "etendue[farm]"') from e
    return openjd.model
