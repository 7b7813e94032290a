"""How frames and jobs end, and who is told of it.

Each function but `close` changes rows within the scheduler's transaction.
"""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from etendue.farm import webhook
from etendue.farm.config import FarmConfig
from etendue.farm.database import Database
from etendue.farm.errors import FarmError
from etendue.farm.events import log
from etendue.farm.models import Frame, Job, User
from etendue.farm.states import FrameState, JobState


class Endings:
    """The ends of a farm's frames and jobs.

    Args:
        database: The farm's, for what notifications leave in the log.
        config: The farm's.
        stop: Set when the scheduler is to end: notifications are not tried again then.
    """

    def __init__(self, database: Database, config: FarmConfig, stop: threading.Event) -> None:
        self._database, self._config, self._stop = database, config, stop
        self._hooks = ThreadPoolExecutor(2, thread_name_prefix="webhook")

    def close(self) -> None:
        """Wait for notifications under way."""
        self._hooks.shutdown(wait=True)

    def fail_frame(self, session: Session, job: Job, frame: Frame, error: str) -> None:
        """Let a frame fail, and its job where nothing else is left of it."""
        if frame.state == FrameState.FAILED:
            return
        frame.state, frame.error, frame.finished_at = FrameState.FAILED.value, error, time.time()
        job.frames_failed += 1
        job.error = job.error or f"frame {frame.number}: {error}"
        job.version += 1
        self.settle(session, job, frame)

    def settle(self, session: Session, job: Job, frame: Frame) -> None:
        """End the job, or let it wait for approval, where nothing of it is left to do."""
        session.flush()
        if frame.state not in (FrameState.DONE, FrameState.FAILED) or job.state not in (JobState.QUEUED, JobState.RUNNING, JobState.PAUSED):
            return
        counts = {
            row[0]: row[1] for row in session.execute(select(Frame.state, func.count()).where(Frame.job_id == job.id).group_by(Frame.state))
        }
        if counts.get(FrameState.QUEUED.value, 0) or counts.get(FrameState.RUNNING.value, 0):
            return
        if counts.get(FrameState.HELD.value, 0):
            job.state = JobState.APPROVAL.value
            log(session, "job-approval", "the first frames are done; the rest waits for approval", job=job.id)
            self._notify(session, job)
        elif counts.get(FrameState.FAILED.value, 0):
            self.end_job(session, job, JobState.FAILED, job.error or "a frame has failed")
        else:
            job.progress = 1.0
            self.end_job(session, job, JobState.DONE, None)

    def end_job(self, session: Session, job: Job, state: JobState, error: str | None) -> None:
        """End a job in a state and tell its owner."""
        job.state, job.error, job.finished_at = state.value, error, time.time()
        job.version += 1
        text = "done" if error is None else f"failed: {error}"
        log(session, f"job-{state}", text, level="info" if error is None else "error", job=job.id)
        self._notify(session, job)

    def _notify(self, session: Session, job: Job) -> None:
        url = job.spec.get("notify")
        if not url:
            return
        owner = session.get_one(User, job.owner_id).name
        keys = ("id", "name", "state", "error", "frames_total", "frames_done", "frames_failed", "core_secs", "cost", "finished_at")
        content = {"owner": owner, **{key: getattr(job, key) for key in keys}}
        self._hooks.submit(self._send, job.id, str(url), content)

    def _send(self, job_id: int, url: str, content: dict[str, object]) -> None:
        text, level = "", "info"
        for attempt in range(3):
            try:
                status = webhook.post(url, content, allow_private=self._config.private_webhooks)
                text, level = f"notified: the answer was {status}", "info" if status < 400 else "warning"
                break
            except FarmError as e:
                text, level = f"not notified: {e}", "warning"
                if self._stop.wait(2.0**attempt):
                    break
        with self._database.begin() as session:
            if session.get(Job, job_id) is not None:
                log(session, "job-notified", text, level=level, job=job_id)
