"""The manifests under deploy/: names, sizes and references that must agree."""

import json
from pathlib import Path

import pytest

pytest.importorskip("yaml", reason="PyYAML is not installed")

import yaml

from etendue.farm.config import FarmConfig

ROOT = Path(__file__).parents[3]
HEAD_KEYS = {"rayStartParams", "template", "serviceType", "headService", "enableIngress"}
GROUP_KEYS = {"groupName", "replicas", "minReplicas", "maxReplicas", "rayStartParams", "template", "numOfHosts", "idleTimeoutSeconds"}
CLUSTER_KEYS = {"rayVersion", "enableInTreeAutoscaling", "autoscalerOptions", "headGroupSpec", "workerGroupSpecs", "suspend"}
AUTOSCALER_KEYS = {"upscalingMode", "idleTimeoutSeconds", "resources", "image", "imagePullPolicy", "env", "envFrom", "version"}


@pytest.fixture(scope="module")
def found() -> dict[str, dict]:
    return {d["kind"]: d for d in yaml.safe_load_all((ROOT / "deploy/kuberay/farm.yaml").read_text(encoding="utf-8"))}


def test_the_cluster_has_the_fields_of_kuberay(found: dict[str, dict]) -> None:
    cluster = found["RayCluster"]
    assert cluster["apiVersion"] == "ray.io/v1"
    spec = cluster["spec"]
    assert set(spec) <= CLUSTER_KEYS
    assert spec["enableInTreeAutoscaling"] is True
    assert set(spec["autoscalerOptions"]) <= AUTOSCALER_KEYS
    assert spec["autoscalerOptions"]["upscalingMode"] in ("Default", "Aggressive", "Conservative")
    assert set(spec["headGroupSpec"]) <= HEAD_KEYS
    # Ray takes text for all of these.
    groups = [spec["headGroupSpec"], *spec["workerGroupSpecs"]]
    assert all(isinstance(v, str) for group in groups for v in group["rayStartParams"].values())
    assert spec["headGroupSpec"]["rayStartParams"]["num-cpus"] == "0"
    names = [group["groupName"] for group in spec["workerGroupSpecs"]]
    assert len(set(names)) == len(names) > 1
    for group in spec["workerGroupSpecs"]:
        assert set(group) <= GROUP_KEYS
        assert 0 <= group["minReplicas"] <= group["replicas"] <= group["maxReplicas"]
        # As a shell would hand it over: JSON within quotes.
        price = json.loads(json.loads(group["rayStartParams"]["resources"]))["etendue_price_micro"]
        assert price > 0
        (container,) = group["template"]["spec"]["containers"]
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["resources"]["limits"]["memory"]


def test_versions_and_names_agree(found: dict[str, dict]) -> None:
    cluster, config, service = found["RayCluster"], found["ConfigMap"], found["Deployment"]
    pinned = dict(
        line.split("==") for line in (ROOT / "requirements-farm.txt").read_text().splitlines() if "==" in line and " " not in line
    )
    assert cluster["spec"]["rayVersion"] == pinned["ray"]
    assert cluster["spec"]["rayVersion"] in (ROOT / "deploy/kuberay/Dockerfile").read_text()
    settings = FarmConfig.model_validate(json.loads(config["data"]["farm.json"]))
    # KubeRay names the head's service after the cluster.
    assert settings.address == f"ray://{cluster['metadata']['name']}-head-svc:10001"
    pod = service["spec"]["template"]
    assert pod["metadata"]["labels"].items() >= service["spec"]["selector"]["matchLabels"].items()
    assert service["spec"]["replicas"] == 1
    assert service["spec"]["strategy"]["type"] == "Recreate"
    volumes = {v["name"] for v in pod["spec"]["volumes"]}
    mounts = {m["name"] for c in pod["spec"]["containers"] + pod["spec"]["initContainers"] for m in c["volumeMounts"]}
    assert mounts == volumes
    if "Service" in found:
        assert found["Service"]["spec"]["selector"].items() <= pod["metadata"]["labels"].items()
