"""Open Job Description templates: out of the farm and back."""

import json
from pathlib import Path

import pytest

pytest.importorskip("openjd.model", reason="openjd-model is not installed")

from etendue.farm import cli
from etendue.farm.errors import InvalidError, NotFoundError
from etendue.farm.openjd import _range, export_job, import_template
from etendue.farm.spec import JobSpec, parse_frames

from .conftest import BALLS, SPIN

PACKAGE = "0" * 64


def back(tmp_path: Path, scene: str, **order: object) -> tuple[JobSpec, JobSpec, list[str]]:
    """Export an order and import it again."""
    spec = JobSpec.model_validate({"package": PACKAGE, "name": "spin", **order})
    template = export_job(spec, scene, "spin")
    path = tmp_path / "job.json"
    path.write_text(json.dumps(template))
    found = import_template(path, {})
    assert len(found) == 1
    assert found[0].scene == tmp_path / scene
    args = template["steps"][0]["script"]["actions"]["onRun"]["args"]
    return spec, JobSpec.model_validate({"package": PACKAGE, **found[0].order}), args


def test_an_order_comes_back(tmp_path: Path) -> None:
    (tmp_path / "spin.pov").write_text(SPIN)
    settings = {"spp": 4, "width": 64, "integrator": "whitted"}
    more = {"formats": ["exr", "png"], "defines": {"Size": 2.5}, "aovs": ["depth"], "exposure": 1.5, "tonemap": "agx"}
    for frames in (None, "1-48", "1-100x5", "1,4,10-12", "7"):
        spec, again, args = back(tmp_path, "spin.pov", settings=settings, frames=frames, **more)
        for key in ("settings", "formats", "aovs", "exposure", "tonemap", "name"):
            assert getattr(again, key) == getattr(spec, key), key
        assert again.defines == {"Size": "2.5"}
        assert again.numbers() == spec.numbers()
        assert again.clock_of(spec.numbers()) == spec.clock_of(spec.numbers())
        assert args[:2] == ["render", "{{Param.Scene}}"]
    spec, again, _ = back(tmp_path, "spin.pov", frames="2-9", last_frame=30, clocks=(-1.0, 3.0))
    assert again.clock_of(range(2, 10)) == pytest.approx(spec.clock_of(range(2, 10)), abs=1e-12)
    runs = [{"integrator": "path", "spp": 4}, {"integrator": "bdpt", "spp": 8}]
    spec, again, _ = back(tmp_path, "spin.pov", command="study", runs=runs, settings={"width": 32})
    assert (again.command, again.runs, again.settings) == ("study", runs, {"width": 32})


def test_ranges_are_those_of_the_numbers() -> None:
    for text in ("1", "1-3", "1-100x5", "1,4,10-12", "1,2,4,5,9", "3,5,7,8", "1-9x2,10-40x3,100"):
        numbers = parse_frames(text)
        assert parse_frames(_range(numbers).replace(":", "x")) == numbers


TEMPLATE = """specificationVersion: jobtemplate-2023-09
name: Two steps
parameterDefinitions:
  - {name: Scene, type: PATH, objectType: FILE, dataFlow: IN, default: balls.xml}
  - {name: Samples, type: INT, default: 4, minValue: 1}
steps:
  - name: Final
    dependencies: [{dependsOn: Look}]
    script: {actions: {onRun: {command: etendue, args: [render, "{{Param.Scene}}", --spp, "{{Param.Samples}}", -o, out.png]}}}
  - name: Look
    parameterSpace: {taskParameterDefinitions: [{name: Method, type: STRING, range: [normals, ao]}]}
    script: {actions: {onRun: {command: etendue, args: [render, "{{Param.Scene}}", --integrator, "{{Task.Param.Method}}", -o, "a.exr"]}}}
"""


def test_a_template_becomes_jobs_that_wait_for_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ETENDUE_FARM", str(tmp_path / "farm"))
    monkeypatch.delenv("ETENDUE_FARM_URL", raising=False)
    (tmp_path / "balls.xml").write_text(BALLS)
    path = tmp_path / "job.yaml"
    path.write_text(TEMPLATE)
    assert cli.main(["import", str(path), "-p", "Samples=16", "--json", "-q"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert list(made) == ["Look", "Final"]
    assert cli.main(["status", str(made["Final"]), "--json"]) == 0
    final = json.loads(capsys.readouterr().out)
    assert (final["state"], final["needs"], final["spec"]["settings"]["spp"]) == ("waiting", [made["Look"]], 16)
    assert final["spec"]["formats"] == ["png"]
    assert cli.main(["export", str(made["Look"])]) == 0
    assert json.loads(capsys.readouterr().out)["specificationVersion"] == "jobtemplate-2023-09"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("command: etendue", "command: rm", "runs `etendue render` alone"),
        ("args: [render", "args: [convert", "runs `etendue render` alone"),
        ("-o, out.png", "--script-output, /tmp", "--script-output"),
        ("--spp,", "--sp,", "--sp"),
        ("steps:", "jobEnvironments:\n  - {name: E, variables: {A: B}}\nsteps:", "environments"),
        ("2023-09", "2022-09", "specificationVersion"),
        ("default: 4", "default: x", "default"),
    ],
)
def test_what_a_farm_does_not_do_is_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "balls.xml").write_text(BALLS)
    path = tmp_path / "job.yaml"
    path.write_text(TEMPLATE.replace(old, new, 1))
    with pytest.raises(InvalidError, match=words):
        import_template(path, {})


def test_hostile_templates_end_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "job.yaml"
    for text in ("", "[]", "a: !!python/object/apply:os.system [x]", "&a [*a]", "{" * 10_000, "\x00", TEMPLATE[:200]):
        path.write_text(text)
        with pytest.raises(InvalidError):
            import_template(path, {})
    path.write_text(TEMPLATE)
    with pytest.raises(NotFoundError, match="no scene"):
        import_template(path, {})
    with pytest.raises(InvalidError):
        import_template(path, {"Nothing": "1"})
    with pytest.raises(InvalidError, match="cannot say `cost`"):
        export_job(JobSpec.model_validate({"package": PACKAGE, "stop": {"cost": 1}}), "a.xml", "a")
