"""The page of a report: one HTML file with everything in it, that prints on one sheet of A4."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

# Nothing may be loaded from anywhere, and nothing may run; what names a file or folder is only text.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_STYLE = """
@page { size: A4; margin: 10mm 12mm; }
* { box-sizing: border-box; }
html { background: #eceff3; }
body { font: 9.2pt/1.32 system-ui, "Segoe UI", Helvetica, Arial, "DejaVu Sans", sans-serif; color: #1b1f24; background: #fff;
  max-width: 210mm; margin: 8mm auto; padding: 11mm 12mm; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
h1 { font-size: 15pt; line-height: 1.2; margin: 0 0 1mm; overflow-wrap: anywhere; }
h2 { font-size: 9.8pt; margin: 2.6mm 0 .8mm; padding-bottom: .4mm; border-bottom: .3mm solid #cfd5db; break-after: avoid; }
p { margin: 0 0 1.2mm; }
.result { font-size: 10.5pt; font-weight: 600; margin-top: 1.5mm; }
.quiet, footer { color: #5c6670; font-size: 8pt; }
img { display: block; width: 100%; height: auto; break-inside: avoid; }
.pictures { margin: 2mm 0 0; }
table { border-collapse: collapse; width: 100%; font-size: 8.3pt; break-inside: avoid; }
th, td { text-align: right; padding: .45mm 1.2mm; border-bottom: .2mm solid #e3e8ee; font-variant-numeric: tabular-nums; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
td:last-child { font-weight: 600; }
.columns { display: grid; grid-template-columns: 1fr 1fr; gap: 0 6mm; }
.wide { grid-template-columns: 1.35fr 1fr; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .3mm 3mm; margin: 0; font-size: 8.3pt; }
dt { color: #5c6670; } dd { margin: 0; overflow-wrap: anywhere; }
ul { margin: 1mm 0 0; padding-left: 4.5mm; font-size: 8pt; } li { margin-bottom: .6mm; }
li.warning::marker { content: "⚠ "; } li span { color: #5c6670; }
.settings { columns: 3; column-gap: 3mm; font-size: 6.9pt; line-height: 1.28; }
.settings div { break-inside: avoid; overflow-wrap: anywhere; }
.settings b { color: #8250df; }
code { display: block; font: 7.6pt/1.3 ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace; background: #f3f4f6;
  padding: 1.2mm 2mm; overflow-wrap: anywhere; white-space: pre-wrap; }
footer { margin-top: 1.5mm; }
@media print { html { background: #fff; } body { margin: 0; padding: 0; max-width: none; } }
@media (max-width: 640px) { .columns, .wide { grid-template-columns: 1fr; } .settings { columns: 2; } body { padding: 5mm; } }
"""


@dataclass(frozen=True)
class Fact:
    """A name and what is to be said of it."""

    name: str
    value: str


@dataclass(frozen=True)
class Finding:
    """Something odd about the mesh."""

    is_warning: bool
    text: str
    meaning: str


@dataclass(frozen=True)
class Page:
    """What stands on the page.

    Attributes:
        title: of the run.
        summary: what was done, a sentence or two.
        pictures: a row of pictures as PNG, or empty.
        chart: the curve as SVG, or empty.
        result: what came out, one sentence.
        quality_note: what the numbers can tell, one sentence.
        columns: names of the columns, then rows of a name and its values.
        mesh: facts on the mesh.
        findings: what is odd about it.
        training: facts on the training.
        settings: each with whether it differs from the preset.
        command: the command line that makes the same again.
        made: by what and when.
    """

    title: str
    summary: str
    pictures: bytes
    chart: bytes
    result: str
    quality_note: str
    columns: Sequence[tuple[str, Sequence[str]]]
    mesh: Sequence[Fact]
    findings: Sequence[Finding]
    training: Sequence[Fact]
    settings: Sequence[tuple[Fact, bool]]
    command: str
    made: str


def page(content: Page) -> str:
    """Return the page as HTML."""
    title = escape(content.title)
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        f"<p>{escape(content.summary)}</p>",
        f'<p class="result">{escape(content.result)}</p>',
    ]
    if content.pictures:
        parts.append(f'<p class="pictures">{_image("png", content.pictures, "The meshes side by side")}</p>')
    parts += [
        '<div class="columns wide"><section><h2>Numbers</h2>',
        _table(content.columns),
        f'<p class="quiet">{escape(content.quality_note)}</p></section>',
        "<section><h2>Mesh</h2>",
        _facts(content.mesh),
        _findings(content.findings),
        "</section></div>",
    ]
    if content.chart:
        parts += ["<h2>Training curve</h2>", _image("svg+xml", content.chart, "Losses and errors over the training steps")]
    parts += [
        '<div class="columns"><section><h2>Training</h2>',
        _facts(content.training),
        "</section><section><h2>Settings</h2>",
        _settings(content.settings),
        "</section></div>",
        "<h2>Make it again</h2>",
        f"<code>{escape(content.command)}</code>",
        f"<footer>{escape(content.made)}.</footer>",
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _image(kind: str, content: bytes, text: str) -> str:
    return f'<img alt="{escape(text)}" src="data:image/{kind};base64,{base64.b64encode(content).decode()}">'


def _table(rows: Sequence[tuple[str, Sequence[str]]]) -> str:
    (corner, names), *others = rows
    head = "".join(f"<th>{escape(name)}</th>" for name in (corner, *names))
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in (name, *values)) + "</tr>\n" for name, values in others
    )
    return f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"


def _facts(facts: Sequence[Fact]) -> str:
    return "<dl>" + "".join(f"<dt>{escape(fact.name)}</dt><dd>{escape(fact.value)}</dd>\n" for fact in facts) + "</dl>"


def _findings(findings: Sequence[Finding]) -> str:
    if not findings:
        return '<p class="quiet">Nothing is odd about it: a clean mesh in one piece.</p>'
    items = [
        f'<li class="{"warning" if item.is_warning else "note"}">{escape(item.text)} <span>{escape(item.meaning)}</span></li>'
        for item in findings
    ]
    return f"<ul>{''.join(items)}</ul>"


def _settings(settings: Sequence[tuple[Fact, bool]]) -> str:
    items = []
    for fact, differs in settings:
        text = f"{escape(fact.name)}: {escape(fact.value)}"
        items.append(f"<div>{f'<b>{text}</b>' if differs else text}</div>")
    changed = any(differs for _, differs in settings)
    note = '<p class="quiet">Bold: other than in the preset.</p>' if changed else ""
    return f'<div class="settings">{"".join(items)}</div>{note}'
