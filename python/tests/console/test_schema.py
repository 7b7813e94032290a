"""The API does what its description says, whatever it is sent (schemathesis)."""

import pytest

from .conftest import Farm, actor

schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")

from hypothesis import HealthCheck, Phase, settings  # noqa: E402
from schemathesis.checks import not_a_server_error  # noqa: E402
from schemathesis.specs.openapi.checks import (  # noqa: E402
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from etendue.console.app import create_app  # noqa: E402
from etendue.console.settings import ConsoleSettings  # noqa: E402

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
USERS = iter(range(1 << 30))


@pytest.fixture
def description(farm: Farm):  # noqa: ANN201
    app = create_app(farm, ConsoleSettings(hosts=["*"], requests_per_sec=1e6, burst=1e9, sign_ins=1e9, uploads_per_min=1e9))
    return schemathesis.openapi.from_asgi("/api/openapi.json", app)


schema = schemathesis.pytest.from_fixture("description")


# Event streams have no end; a client that hangs up is tested elsewhere.
@schema.exclude(path="/api/v1/events").parametrize()
@settings(
    max_examples=6,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
def test_the_api_keeps_its_word(case, farm: Farm) -> None:  # noqa: ANN001
    # Some of what is tried revokes tokens.
    token = farm.accounts.create_token(actor(farm, "ada"), f"try {next(USERS)}")
    case.call_and_validate(headers={"authorization": f"Bearer {token}"}, checks=CHECKS)
