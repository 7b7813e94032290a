"""Signing in and out, one's own account, and users."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from etendue.console import auth
from etendue.console.auth import TheFarm, Who, console_of
from etendue.console.routes.parameters import Name, Password, refusals
from etendue.farm.accounts import SignedIn
from etendue.farm.errors import ForbiddenError
from etendue.farm.states import Role
from etendue.farm.views import TokenView, UserView

router = APIRouter(tags=["accounts"])

UserName = Annotated[str, Path(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9._@-]*$", description="A user's name.")]
Share = Annotated[float, Field(gt=0, le=1e6)]
Quota = Annotated[float, Field(ge=0, le=1e15)]


class Order(BaseModel):
    """A request's body: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid")


class Credentials(Order):
    """Name and password."""

    name: Name
    password: Password


class Session(BaseModel):
    """A browser's session."""

    name: str
    role: str
    csrf: str
    """What requests that change something carry as `X-CSRF-Token`."""
    expires_in_secs: int


class NewPassword(Order):
    """A change of one's own password."""

    old: Password
    new: Password


class NewUser(Order):
    """A user to be."""

    name: Name
    password: Password | None = None
    role: Role = Role.ARTIST
    share: Share = 1.0
    max_jobs: Annotated[int, Field(ge=0, le=1 << 31)] | None = None
    max_bytes: Annotated[int, Field(ge=0, le=1 << 53)] | None = None
    max_core_secs: Quota | None = None


class UserChange(Order):
    """Changes of a user; what is left out stays. A quota that is null is lifted."""

    password: Password | None = None
    role: Role | None = None
    is_active: bool | None = None
    share: Share | None = None
    max_jobs: Annotated[int, Field(ge=0, le=1 << 31)] | None = None
    max_bytes: Annotated[int, Field(ge=0, le=1 << 53)] | None = None
    max_core_secs: Quota | None = None


class NewToken(Order):
    """A token to be."""

    name: Name
    days: Annotated[float, Field(gt=0, le=36_500)] | None = None
    """How long it is valid; without limit where not given."""


class MadeToken(BaseModel):
    """A token that has just been made."""

    token: str
    """Its text: told once, and not kept."""


def start(request: Request, response: Response, session: SignedIn) -> None:
    """Set the cookie of a new session."""
    console = console_of(request)
    response.set_cookie(
        console.cookie,
        session.cookie,
        max_age=auth.expires_in(session),
        path="/",
        secure=console.settings.is_https,
        httponly=True,
        samesite="lax",
    )


@router.post("/session", responses=refusals(403))
def sign_in(request: Request, response: Response, given: Credentials) -> Session:
    """Sign a browser in; the answer sets a cookie."""
    if not auth.is_own_origin(request):
        raise ForbiddenError("signing in works from the console's own page alone")
    session = auth.sign_in(request, given.name, given.password)
    start(request, response, session)
    return _session(session)


@router.get("/session", responses=refusals())
def session(request: Request) -> Session | None:
    """Tell who is signed in; null for nobody."""
    found = auth.session_of(request)
    return _session(found) if found is not None else None


@router.delete("/session", status_code=204, responses=refusals(403))
def sign_out(request: Request, response: Response, who: Who, farm: TheFarm) -> None:
    """Sign the browser out."""
    console = console_of(request)
    cookie = request.cookies.get(console.cookie)
    if cookie:
        farm.accounts.sign_out(cookie)
    response.delete_cookie(console.cookie, path="/", secure=console.settings.is_https, httponly=True, samesite="lax")


def _session(found: SignedIn) -> Session:
    return Session(name=found.actor.name, role=str(found.actor.role), csrf=found.csrf, expires_in_secs=auth.expires_in(found))


@router.get("/me", responses=refusals())
def me(who: Who, farm: TheFarm) -> UserView:
    """Tell one's own role and quotas."""
    return farm.accounts.get(who, who.name)


@router.post("/me/password", status_code=204, responses=refusals(403))
def change_password(request: Request, who: Who, farm: TheFarm, given: NewPassword) -> None:
    """Change one's own password; ends all of one's browser sessions."""
    # A browser that was left open is not enough.
    auth.sign_in(request, who.name, given.old)
    farm.accounts.update(who, who.name, password=given.new)


@router.get("/tokens", responses=refusals())
def tokens(who: Who, farm: TheFarm) -> list[TokenView]:
    """List one's own API tokens."""
    return farm.accounts.tokens(who)


@router.post("/tokens", status_code=201, responses=refusals(403))
def create_token(who: Who, farm: TheFarm, given: NewToken) -> MadeToken:
    """Make an API token; its text is told once."""
    return MadeToken(token=farm.accounts.create_token(who, given.name, days=given.days))


@router.delete("/tokens/{token_id}", status_code=204, responses=refusals(403, 404))
def revoke_token(who: Who, farm: TheFarm, token_id: Annotated[int, Path(ge=1, le=(1 << 31) - 1)]) -> None:
    """Delete an API token."""
    farm.accounts.revoke_token(who, token_id)


@router.get("/users", responses=refusals(403))
def users(who: Who, farm: TheFarm) -> list[UserView]:
    """List all users; for administrators."""
    return farm.accounts.users(who)


@router.post("/users", status_code=201, responses=refusals(403, 409))
def create_user(who: Who, farm: TheFarm, given: NewUser) -> UserView:
    """Make a user; for administrators."""
    return farm.accounts.create(who, **given.model_dump())


@router.patch("/users/{name}", responses=refusals(403, 404, 409))
def update_user(who: Who, farm: TheFarm, name: UserName, given: UserChange) -> UserView:
    """Change a user; for administrators."""
    if name == who.name and given.password is not None:
        raise ForbiddenError("change your own password with the old one, at /me/password")
    values: dict[str, Any] = {key: getattr(given, key) for key in ("password", "role", "is_active", "share")}
    quotas: dict[str, float | None] = {
        key: getattr(given, key) for key in ("max_jobs", "max_bytes", "max_core_secs") if key in given.model_fields_set
    }
    return farm.accounts.update(who, name, **values, quotas=quotas or None)
