"""Users, passwords, API tokens and browser sessions.

Passwords are hashed with scrypt (C. Percival, "Stronger key derivation via sequential memory-hard functions", 2009; RFC 7914) from the
standard library. Tokens and cookies have 256 random bits; only their SHA-256 is kept.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import time
from dataclasses import dataclass

from sqlalchemy import delete, func, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from etendue.farm.database import Database
from etendue.farm.errors import ConflictError, ForbiddenError, InvalidError, NotFoundError
from etendue.farm.events import audit
from etendue.farm.models import Token, User, WebSession
from etendue.farm.states import Role
from etendue.farm.views import TokenView, UserView

MIN_PASSWORD = 10
"""Fewest characters of a password."""
MAX_PASSWORD = 1024
SESSION_SECS = 12 * 3600.0
"""How long a browser stays signed in."""
TOKEN_PREFIX = "etf_"
_ORDER = [Role.VIEWER, Role.ARTIST, Role.ADMIN]
# 2^15 × 8 × 128 bytes: 32 MiB and about 0.1 s for each attempt.
_N, _R, _P = 1 << 15, 8, 1
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")


@dataclass(frozen=True)
class Actor:
    """Who asks the service for something."""

    id: int
    name: str
    role: Role

    def can(self, role: Role) -> bool:
        """Return whether the user may do what a role may."""
        return _ORDER.index(self.role) >= _ORDER.index(role)

    def need(self, role: Role) -> None:
        """Check that the user may do what a role may.

        Raises:
            ForbiddenError: No.
        """
        if not self.can(role):
            raise ForbiddenError(f"this needs the role `{role}`; {self.name} has `{self.role}`")


@dataclass(frozen=True)
class SignedIn:
    """A browser's session. `cookie` is told once, at sign-in; later it is empty."""

    actor: Actor
    cookie: str
    csrf: str
    expires_at: float


def hash_password(password: str) -> str:
    """Return the text that is kept for a password.

    Raises:
        InvalidError: It is too short or too long.
    """
    if not MIN_PASSWORD <= len(password) <= MAX_PASSWORD:
        raise InvalidError(f"a password has {MIN_PASSWORD} to {MAX_PASSWORD} characters")
    salt = secrets.token_bytes(16)
    return f"scrypt${_N}${_R}${_P}${salt.hex()}${_scrypt(password, salt, _N, _R, _P).hex()}"


def check_password(password: str, kept: str) -> bool:
    """Return whether a password is the one of `hash_password`, in a time that does not tell where it differs."""
    try:
        scheme, n, r, p, salt, digest = kept.split("$")
        if scheme != "scrypt" or len(password) > MAX_PASSWORD:
            return False
        return hmac.compare_digest(_scrypt(password, bytes.fromhex(salt), int(n), int(r), int(p)), bytes.fromhex(digest))
    except ValueError:
        return False


def _scrypt(password: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    return hashlib.scrypt(password.encode("utf-8", "surrogatepass"), salt=salt, n=n, r=r, p=p, maxmem=1 << 27, dklen=32)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


# Someone who tries names must not learn from the time which exist.
_NOBODY = "scrypt$32768$8$1$" + "00" * 16 + "$" + "00" * 32


def actor_of(user: User) -> Actor:
    """Return the actor of a user's row."""
    return Actor(user.id, user.name, Role(user.role))


class Accounts:
    """The users of a farm."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def local(self) -> Actor:
        """Return the user `local`, an administrator: who can open the farm's folder may do everything. Made when first asked for."""
        with self._database.begin() as session:
            user = session.scalar(select(User).where(User.name == "local"))
            if user is None:
                user = User(name="local", role=Role.ADMIN.value)
                session.add(user)
                session.flush()
            return actor_of(user)

    def create(
        self,
        actor: Actor,
        name: str,
        *,
        password: str | None = None,
        role: Role = Role.ARTIST,
        share: float = 1.0,
        max_jobs: int | None = None,
        max_bytes: int | None = None,
        max_core_secs: float | None = None,
    ) -> UserView:
        """Make a user.

        Raises:
            ForbiddenError: The actor is no administrator.
            InvalidError: Name or password does not fit.
            ConflictError: There is a user of this name.
        """
        actor.need(Role.ADMIN)
        if not _NAME.fullmatch(name):
            raise InvalidError("a user's name has 1 to 64 letters, digits and . _ @ -, and begins with a letter or digit")
        if not 0 < share <= 1e6:
            raise InvalidError("a user's share is a number above 0")
        kept = None if password is None else hash_password(password)
        user = User(name=name, role=Role(role).value, password_hash=kept, share=share, max_jobs=max_jobs, max_bytes=max_bytes)
        user.max_core_secs = max_core_secs
        try:
            with self._database.begin() as session:
                session.add(user)
                session.flush()
                audit(session, actor.id, "user-created", f"{actor.name} created the user {name} as {role}")
                return UserView.model_validate(user)
        except IntegrityError as e:
            raise ConflictError(f"there is a user `{name}` already") from e

    def update(
        self,
        actor: Actor,
        name: str,
        *,
        password: str | None = None,
        role: Role | None = None,
        is_active: bool | None = None,
        share: float | None = None,
        quotas: dict[str, float | None] | None = None,
    ) -> UserView:
        """Change a user: administrators anything, others their own password.

        Args:
            actor: Who asks.
            name: The user.
            password: The new password; ends all of the user's browser sessions.
            role: The new role.
            is_active: Whether they may sign in.
            share: The new share.
            quotas: New values of `max_jobs`, `max_bytes`, `max_core_secs`; None lifts one.
        """
        own = actor.name == name and role is None and is_active is None and share is None and quotas is None
        if not own:
            actor.need(Role.ADMIN)
        unknown = set(quotas or {}) - {"max_jobs", "max_bytes", "max_core_secs"}
        if unknown:
            raise InvalidError(f"there is no quota `{unknown.pop()}`")
        kept = None if password is None else hash_password(password)
        with self._database.begin() as session:
            user = _user(session, name)
            if kept is not None:
                user.password_hash = kept
                session.execute(delete(WebSession).where(WebSession.user_id == user.id))
            if role is not None:
                user.role = Role(role).value
            if share is not None:
                if not 0 < share <= 1e6:
                    raise InvalidError("a user's share is a number above 0")
                user.share = share
            for key, value in (quotas or {}).items():
                setattr(user, key, value)
            if is_active is not None:
                user.is_active = is_active
            if is_active is False:
                session.execute(delete(WebSession).where(WebSession.user_id == user.id))
            admins = select(func.count()).select_from(User).where(User.role == Role.ADMIN.value, User.is_active)
            session.flush()
            if session.scalar(admins) == 0:
                raise ConflictError("a farm keeps at least one active administrator")
            audit(session, actor.id, "user-changed", f"{actor.name} changed the user {name}")
            return UserView.model_validate(user)

    def users(self, actor: Actor) -> list[UserView]:
        """Return all users, for administrators."""
        actor.need(Role.ADMIN)
        with self._database.read() as session:
            return [UserView.model_validate(user) for user in session.scalars(select(User).order_by(User.name))]

    def get(self, actor: Actor, name: str) -> UserView:
        """Return a user: oneself, or anyone for administrators."""
        if actor.name != name:
            actor.need(Role.ADMIN)
        with self._database.read() as session:
            return UserView.model_validate(_user(session, name))

    # ---- tokens ----

    def create_token(self, actor: Actor, name: str, *, days: float | None = None, user: str | None = None) -> str:
        """Make a token and return its text, which is not kept. Administrators may make one for another `user`."""
        if user is not None and user != actor.name:
            actor.need(Role.ADMIN)
        if not 1 <= len(name) <= 64 or any(ord(c) < 32 for c in name):
            raise InvalidError("a token's name has 1 to 64 characters")
        if days is not None and not 0 < days < 36500:
            raise InvalidError("a token is valid for a number of days above 0")
        text = TOKEN_PREFIX + secrets.token_urlsafe(32)
        with self._database.begin() as session:
            owner = _user(session, user or actor.name)
            expires = None if days is None else time.time() + days * 86400
            session.add(Token(user_id=owner.id, name=name, hash=_sha256(text), expires_at=expires))
            audit(session, actor.id, "token-created", f"{actor.name} made the token `{name}` for {owner.name}")
        return text

    def tokens(self, actor: Actor) -> list[TokenView]:
        """Return the actor's own tokens, without their texts."""
        with self._database.read() as session:
            rows = session.scalars(select(Token).where(Token.user_id == actor.id).order_by(Token.id))
            return [TokenView.model_validate(row) for row in rows]

    def revoke_token(self, actor: Actor, token_id: int) -> None:
        """Delete one of the actor's tokens; administrators any.

        Raises:
            NotFoundError: There is none.
        """
        with self._database.begin() as session:
            token = session.get(Token, token_id)
            if token is None or (token.user_id != actor.id and not actor.can(Role.ADMIN)):
                raise NotFoundError(f"there is no token {token_id}")
            session.delete(token)
            audit(session, actor.id, "token-revoked", f"{actor.name} revoked the token `{token.name}`")

    def by_token(self, text: str) -> Actor | None:
        """Return whose token this is; None for an unknown or expired one, and for users who are not active."""
        now = time.time()
        with self._database.read() as session:
            row = session.execute(select(Token, User).join(User).where(Token.hash == _sha256(text))).first()
        if row is None:
            return None
        token, user = row
        if not user.is_active or (token.expires_at is not None and token.expires_at < now):
            return None
        # Not for each request: it is a write.
        if token.used_at is None or now - token.used_at > 60:
            with self._database.begin() as session:
                kept = session.get(Token, token.id)
                if kept is not None:
                    kept.used_at = now
        return actor_of(user)

    # ---- browsers ----

    def sign_in(self, name: str, password: str) -> SignedIn | None:
        """Return a new browser session, or None where name or password is wrong. Limiting the rate of attempts is the caller's part."""
        with self._database.read() as session:
            user = session.scalar(select(User).where(User.name == name[:64]))
        kept = user.password_hash if user is not None and user.is_active else None
        fits = check_password(password, kept or _NOBODY)
        if user is None or kept is None or not fits:
            shown = name[:64] if _NAME.fullmatch(name[:64]) else "someone"
            with self._database.begin() as session:
                audit(session, user.id if user else None, "sign-in-refused", f"{shown} did not sign in: wrong name or password")
            return None
        return self.open_session(actor_of(user))

    def open_session(self, actor: Actor) -> SignedIn:
        """Return a new browser session of a user who has shown in another way who they are."""
        cookie, csrf, now = secrets.token_urlsafe(32), secrets.token_urlsafe(32), time.time()
        with self._database.begin() as session:
            session.execute(delete(WebSession).where(WebSession.expires_at < now))
            session.add(WebSession(hash=_sha256(cookie), user_id=actor.id, csrf=csrf, expires_at=now + SESSION_SECS))
            audit(session, actor.id, "sign-in", f"{actor.name} signed in")
        return SignedIn(actor, cookie, csrf, now + SESSION_SECS)

    def by_cookie(self, cookie: str) -> SignedIn | None:
        """Return the browser session of a cookie; None for an unknown or expired one."""
        with self._database.read() as session:
            row = session.execute(select(WebSession, User).join(User).where(WebSession.hash == _sha256(cookie))).first()
        if row is None:
            return None
        kept, user = row
        if not user.is_active or kept.expires_at < time.time():
            return None
        return SignedIn(actor_of(user), "", kept.csrf, kept.expires_at)

    def sign_out(self, cookie: str) -> None:
        """End the browser session of a cookie."""
        with self._database.begin() as session:
            session.execute(delete(WebSession).where(WebSession.hash == _sha256(cookie)))


def _user(session: Session, name: str) -> User:
    user = session.scalar(select(User).where(User.name == name))
    if user is None:
        raise NotFoundError(f"there is no user `{name[:64]}`")
    return user
