"""The API does what its description says, whatever it is sent (schemathesis)."""

import pytest

from .conftest import Farm, actor

schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")

from hypothesis import HealthCheck, Phase, given, settings  # noqa: E402
from schemathesis.checks import not_a_server_error  # noqa: E402
from schemathesis.specs.openapi.checks import (  # noqa: E402
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from etendue.console.app import create_app  # noqa: E402
from etendue.console.settings import ConsoleSettings  # noqa: E402

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]


QUICK = settings(
    max_examples=4,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)


def test_the_api_keeps_its_word(farm: Farm) -> None:
    app = create_app(farm, ConsoleSettings(hosts=["*"], requests_per_sec=1e6, burst=1e9, sign_ins=1e9, uploads_per_min=1e9))
    schema = schemathesis.openapi.from_asgi("/api/openapi.json", app)
    ada = actor(farm, "ada")
    tried = 0
    for found in schema.get_all_operations():
        operation = found.ok()
        # Event streams have no end; a client that hangs up is tested elsewhere.
        if operation.path == "/api/v1/events":
            continue

        @QUICK
        @given(case=operation.as_strategy())
        def check(case) -> None:
            # Some of what is tried revokes tokens.
            token = farm.accounts.create_token(ada, "try")
            case.call_and_validate(headers={"authorization": f"Bearer {token}"}, checks=CHECKS)

        check()
        tried += 1
    assert tried > 35
