from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from dmp import __version__
from dmp.cli import main
from dmp.exports import report as report_module
from dmp.exports.drawing import DrawingError
from dmp.exports.report import write_report
from dmp.metrics import GroundTruth
from dmp.runs import Run


class Page(HTMLParser):
    """Collects texts, addresses and open tags."""

    def __init__(self, content: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.tags: list[str] = []
        self.feed(content)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> object:
        raise DrawingError("No picture can be drawn.")

    monkeypatch.setattr(report_module, "drawn", fails)


@pytest.mark.usefixtures("can_draw")
def test_a_report_holds_its_numbers_and_needs_nothing_else(denoised: Run, tmp_path: Path) -> None:
    denoised.keep(15)
    path = tmp_path / "report.html"
    with pytest.raises(SystemExit) as ended:
        main(["report", str(denoised.folder), "-o", str(path)])
    assert ended.value.code == 0
    content = path.read_text(encoding="utf-8")
    page = Page(content)
    assert page.open == []
    truth = denoised.problem().ground_truth
    assert isinstance(truth, GroundTruth)
    for positions in (denoised.problem().target, denoised.snapshot(15).vertices):
        assert f"{truth.mad(positions):.2f}°" in page.text
        assert f"{truth.vertex_error(positions):.3f}" in page.text
    assert "step 15 of 20, kept by a person" in page.text
    assert "258 vertices" in page.text
    assert f"dmp-viewer {__version__}" in page.text
    assert "20 steps" in page.text
    assert "torch" in page.text
    assert "dmp denoise" in page.text
    assert "--steps 20" in page.text
    # Names are text, never markup.
    assert "<ball>" not in content
    assert "<ball>" in page.text
    # Nothing is loaded from anywhere, and nothing runs.
    assert len(page.addresses) == 2
    kinds = [re.match(r"data:image/([a-z+]+);base64,", address) for address in page.addresses]
    assert [kind[1] for kind in kinds if kind] == ["png", "svg+xml"]
    assert not {"script", "link", "iframe", "object", "a"} & set(page.tags)
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", content).replace("http-equiv", "")
    picture = base64.b64decode(page.addresses[0].partition(",")[2])
    assert picture.startswith(b"\x89PNG")
    assert b"svg" in base64.b64decode(page.addresses[1].partition(",")[2])


@pytest.mark.usefixtures("without_pictures")
def test_without_pictures_there_is_still_a_report(completed: Run, tmp_path: Path) -> None:
    notes = write_report(tmp_path / "r.html", completed, 4)
    assert notes == ("The report has no pictures. No picture can be drawn.",)
    page = Page((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "There is no ground truth" in page.text
    inserted = int((~completed.problem().known).sum())
    assert f"{inserted} vertices were inserted, and every other vertex stayed exactly where it was." in page.text
    assert "The surface is open" in page.text


@pytest.mark.usefixtures("without_pictures")
def test_the_command_in_the_report_gives_the_settings_of_the_run(denoised: Run, tmp_path: Path) -> None:
    from dmp.commands import restoring

    write_report(tmp_path / "r.html", denoised, 20)
    text = Page((tmp_path / "r.html").read_text(encoding="utf-8")).text
    found = re.search(r"dmp denoise .*?--keep 20", text)
    assert found is not None
    seen: dict[str, object] = {}

    def instead(_mesh: Path, settings: object, **more: object) -> int:
        seen.update(settings=settings, **more)
        return 0

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(restoring, "_restore", instead)
        with pytest.raises(SystemExit):
            main(found[0].split()[1:])
    assert seen["settings"] == denoised.settings
    assert seen["keep"] == "20"
