"""The check of dependencies finds what it is for."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

PATH = Path(__file__).parent.parent.parent / "scripts" / "check_dependencies.py"


@pytest.fixture(scope="module")
def check() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_dependencies", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def package(name: str, *dependencies: str) -> dict[str, object]:
    return {"id": name, "name": name, "dependencies": [{"name": d} for d in dependencies]}


def test_the_way_back_is_refused(check: ModuleType) -> None:
    packages = [package("etendue-scene", "serde", "etendue-render"), package("etendue-render", "etendue-scene")]
    faults = check.direction_faults({"packages": packages, "workspace_members": ["etendue-scene", "etendue-render"]})
    assert faults == ["etendue-scene must not depend on etendue-render: the direction is cli, py → gpu → render → scene → procedural."]


def test_crates_outside_of_the_list_are_refused(check: ModuleType) -> None:
    faults = check.direction_faults({"packages": [package("etendue-util")], "workspace_members": ["etendue-util"]})
    assert len(faults) == 1
    assert "etendue-util" in faults[0]


@pytest.mark.parametrize(
    ("expression", "is_allowed"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("MIT/GPL-3.0-only", True),
        ("MIT AND GPL-3.0-only", False),
        ("(MIT OR GPL-3.0-only) AND Zlib", True),
        ("(MIT OR Zlib) AND GPL-3.0-only", False),
        ("GPL-3.0-only OR Apache-2.0 WITH LLVM-exception", True),
        ("Apache-2.0 WITH Classpath-exception-2.0", False),
        ("GPL-2.0-only OR MIT AND Zlib", True),
    ],
)
def test_license_expressions(check: ModuleType, expression: str, is_allowed: bool) -> None:
    allowed = {"MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"}
    assert check.satisfied(expression, allowed) == is_allowed


def test_packages_without_a_license_are_refused(check: ModuleType) -> None:
    packages = [{"name": "a", "version": "1", "license": None}, {"name": "b", "version": "2", "license": "SSPL-1.0"}]
    faults = check.license_faults({"packages": packages}, {"MIT"})
    assert faults == [
        "The dependency a 1 states no license.",
        "The dependency b 2 has the license SSPL-1.0, which deny.toml does not allow.",
    ]
