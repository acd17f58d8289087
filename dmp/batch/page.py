"""The page of a batch: one HTML file that needs nothing beside it, with a picture of each job."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from typing import BinaryIO

from dmp.batch.folder import BatchFolder, Outcome
from dmp.batch.jobs import BatchJob
from dmp.durations import duration

_HEAD = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>Batch</title><style>
:root { color-scheme: light dark; }
body { font: 15px/1.4 system-ui, sans-serif; margin: 24px; }
h1 { font-size: 22px; margin: 0 0 4px; } h2 { font-size: 17px; margin: 28px 0 8px; }
.jobs { display: grid; grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); gap: 12px; margin-top: 16px; }
.job { border: 1px solid #8885; border-radius: 8px; padding: 10px; overflow-wrap: anywhere; }
.job.failed { border-color: #c0392b; } .job.waiting { opacity: .6; }
.job img { width: 320px; max-width: 100%; background: #fff; border-radius: 4px; display: block; }
.job b { display: block; margin: 6px 0 2px; } .small { font-size: 13px; opacity: .8; } .reason { color: #c0392b; }
</style></head><body>
"""


def write_page(file: BinaryIO, jobs: Sequence[BatchJob], store: BatchFolder, totals: str) -> None:
    """Write the page, one job after the other, so that a thousand pictures need no memory (raises OSError)."""
    file.write(f"{_HEAD}<h1>Batch</h1>\n<p>{escape(totals)} Pictures: input, result.</p>\n<div class='jobs'>\n".encode())
    for job in jobs:
        file.write(_card(job, store, store.read(job.name)).encode())
    file.write(b"</div></body></html>\n")


def _card(job: BatchJob, store: BatchFolder, outcome: Outcome | None) -> str:
    from dmp.batch.summary import measures, state_of

    state = state_of(outcome)
    parts = [f"<div class='job {state}'>"]
    if outcome is not None and not outcome.failure:
        parts.append(_picture(job, store))
    parts.append(f"<b>{escape(job.name)}</b>")
    if outcome is None:
        parts.append("<div class='small'>Waiting.</div>")
    elif outcome.failure:
        parts.append(f"<div class='reason'>{escape(outcome.failure)}</div>")
    else:
        if told := measures(outcome):
            parts.append(f"<div>{escape(told)}</div>")
        facts = [
            f"{outcome.vertices:,} vertices",
            f"step {outcome.step:,} of {outcome.steps:,}",
            duration(outcome.wall_seconds),
        ]
        facts += [outcome.device, f"preset {outcome.preset}, seed {outcome.seed}"]
        parts.append(f"<div class='small'>{escape(' · '.join(fact for fact in facts if fact))}</div>")
        parts += [f"<div class='small'>{escape(note)}</div>" for note in outcome.notes]
    if outcome is not None:
        parts += [f"<div class='small'>Retry: {escape(text)}.</div>" for text in outcome.retries]
    parts.append("</div>\n")
    return "".join(parts)


def _picture(job: BatchJob, store: BatchFolder) -> str:
    try:
        content = store.picture(job.name).read_bytes()
    except OSError:
        return ""
    return f"<img alt='{escape(job.name)}: input and result' src='data:image/png;base64,{base64.b64encode(content).decode()}'>"
