"""Pictures and animations as files, made by a process of their own."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dmp.cli import main
from dmp.exports import drawing, encoding
from dmp.exports.drawing import DrawingError, write_drawing
from dmp.exports.encoding import GifFile, Mp4File, PictureFiles
from dmp.exports.of_runs import Photographer, Wish
from dmp.exports.scenes import Frame, Sheet
from dmp.exports.watching import CancelledError, Watch
from dmp.runs import Run

ANIMATED = Sheet(64, 64, (), kind="gif", frames_per_second=20.0, hold_seconds=1.0)


def moving_square(frame: int) -> Image.Image:
    picture = Image.new("RGB", (64, 64), "white")
    picture.paste("red", (4 * frame, 10, 4 * frame + 12, 22))
    return picture


def test_a_gif_has_every_frame_its_speed_and_its_rest(tmp_path: Path) -> None:
    made = GifFile(tmp_path, ANIMATED)
    for frame in range(8):
        made.add(moving_square(frame))
    (path,) = made.finish()
    with Image.open(path) as gif:
        assert gif.n_frames == 8
        assert gif.info["loop"] == 0
        frames, durations = [], []
        for index in range(8):
            gif.seek(index)
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
            durations.append(gif.info["duration"])
    assert durations == [50] * 7 + [1050]
    for index, frame in enumerate(frames):
        assert np.abs(frame - np.asarray(moving_square(index)).astype(int)).max() < 12


def test_a_gif_that_would_fill_the_memory_is_refused_before_anything_is_drawn(tmp_path: Path) -> None:
    with pytest.raises(DrawingError, match=r"2,000 frames of 1920 x 1080.*or MP4"):
        write_drawing(tmp_path / "a.gif", Sheet(1920, 1080, (), kind="gif"), iter(()), 2000)


def fake_ffmpeg(folder: Path, code: str) -> Path:
    program = folder / "ffmpeg"
    program.write_text(f"#!{sys.executable}\nimport sys\ncontent = sys.stdin.buffer.read()\n{code}\n")
    program.chmod(program.stat().st_mode | stat.S_IEXEC)
    return program


@pytest.mark.skipif(os.name == "nt", reason="a script cannot stand for a program on Windows")
def test_ffmpeg_gets_every_frame_and_the_last_one_for_as_long_as_it_rests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = fake_ffmpeg(tmp_path, "open(sys.argv[-1], 'wb').write(content)")
    monkeypatch.setattr(encoding, "find_ffmpeg", lambda: str(program))
    made = Mp4File(tmp_path, replace(ANIMATED, kind="mp4", frames_per_second=2.0))
    for frame in range(3):
        made.add(moving_square(frame))
    (path,) = made.finish()
    sent = np.frombuffer(path.read_bytes(), dtype=np.uint8).reshape(-1, 64, 64, 3)
    assert len(sent) == 3 + 2
    assert np.array_equal(sent[1], np.asarray(moving_square(1)))
    assert np.array_equal(sent[4], np.asarray(moving_square(2)))


@pytest.mark.skipif(os.name == "nt", reason="a script cannot stand for a program on Windows")
def test_what_ffmpeg_refuses_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = fake_ffmpeg(tmp_path, "print('no libx264 here', file=sys.stderr); sys.exit(1)")
    monkeypatch.setattr(encoding, "find_ffmpeg", lambda: str(program))
    made = Mp4File(tmp_path, replace(ANIMATED, kind="mp4"))
    made.add(moving_square(0))
    with pytest.raises(Exception, match=r"no libx264 here.*GIF"):
        made.finish()


def test_a_real_mp4_where_ffmpeg_is_installed(tmp_path: Path) -> None:
    if encoding.find_ffmpeg() is None:
        pytest.skip("ffmpeg is not installed")
    made = Mp4File(tmp_path, replace(ANIMATED, kind="mp4"))
    for frame in range(8):
        made.add(moving_square(frame))
    (path,) = made.finish()
    assert path.read_bytes()[4:8] == b"ftyp"


def test_without_ffmpeg_a_sentence_says_what_to_do(
    denoised: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if encoding.find_ffmpeg() is not None:
        pytest.skip("ffmpeg is installed")
    with pytest.raises(SystemExit) as ended:
        main(["animate", str(denoised.folder), "-o", str(tmp_path / "a.mp4")])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert "pip install imageio-ffmpeg" in said
    assert "GIF" in said
    assert not (tmp_path / "a.mp4").exists()


def test_pictures_keep_their_numbers(tmp_path: Path) -> None:
    made = PictureFiles(tmp_path, replace(ANIMATED, kind="png"))
    made.add(moving_square(0))
    made.add(moving_square(1))
    assert [path.name for path in made.finish()] == ["000000.png", "000001.png"]


@pytest.mark.usefixtures("can_draw")
def test_the_commands_write_a_transparent_picture_and_an_animation(
    denoised: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, gif = tmp_path / "p.png", tmp_path / "a.gif"
    commands = (
        ["picture", str(denoised.folder), "-o", str(picture), "--transparent", "--size", "300x120", "--step", "15"],
        ["animate", str(denoised.folder), "-o", str(gif), "--size", "200x120", "--panes", "input,predicted"],
    )
    for command in commands:
        with pytest.raises(SystemExit) as ended:
            main(command)
        assert ended.value.code == 0
    with Image.open(picture) as image:
        assert (image.mode, image.size) == ("RGBA", (300, 120))
        opacity = np.asarray(image)[..., 3]
        assert opacity[60, 1] == 0
        assert opacity[55, 50] == opacity[55, 250] == 255
    with Image.open(gif) as animation:
        assert (animation.n_frames, animation.size) == (5, (200, 120))
        frames = []
        for index in range(5):
            animation.seek(index)
            frames.append(np.asarray(animation.convert("RGB")).astype(int))
    for before, after in pairwise(frames):
        assert np.abs(before[20:, 100:] - after[20:, 100:]).max() > 20
        assert np.array_equal(before[:, :98], after[:, :98])
    assert "5 frames" in capsys.readouterr().err


@pytest.mark.usefixtures("can_draw")
def test_a_cancelled_export_leaves_the_old_file_and_no_child(denoised: Run, tmp_path: Path) -> None:
    sheet, frames = Photographer(denoised, Wish(120, 80)).animation([0, 5, 10] * 100, kind="gif", frames_per_second=10)
    target = tmp_path / "a.gif"
    target.write_bytes(b"old")
    told: list[str] = []
    watch: Watch

    def tell(text: str, done: int, _total: int) -> None:
        told.append(text)
        if done == 2:
            threading.Thread(target=watch.cancel).start()

    watch = Watch(tell)
    with pytest.raises(CancelledError):
        write_drawing(target, sheet, frames, 300, watch)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.glob(".*")) == []
    assert len(told) < 250


def test_a_child_that_dies_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    false = shutil.which("false")
    if false is None:
        pytest.skip("there is no program that only fails")
    monkeypatch.setattr(drawing.sys, "executable", false)
    with pytest.raises(DrawingError, match="OpenGL does not work here"):
        write_drawing(tmp_path / "p.png", Sheet(64, 64, ()), [Frame(())], 1)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["picture", "{run}", "-o", "p.bmp"], "p.bmp: the name does not say a format"),
        (["picture", "{run}", "-o", "no/p.png"], "the folder no does not exist"),
        (["picture", "{run}", "-o", "p.png", "--size", "huge"], "--size is 'huge'"),
        (["picture", "{run}", "-o", "p.png", "--size", "9000x9000"], "9000 x 9000"),
        (["picture", "{run}", "-o", "p.png", "--panes", "input,output"], "there is no 'output'"),
        (["picture", "{run}", "-o", "p.png", "--limits", "2", "1"], "the second must be larger"),
        (["picture", "{run}", "-o", "p.png", "--eye", "0", "0", "0"], "no direction"),
        (["picture", "{run}", "-o", "p.jpg", "--transparent"], "PNG"),
        (["picture", "{run}", "-o", "p.png", "--step", "7"], "The nearest is"),
        (["picture", "{mesh}", "-o", "p.png", "--step", "7"], "no steps"),
        (["picture", "{mesh}", "-o", "p.png", "--colour-by", "error"], "A mesh alone has no error"),
        (["animate", "{run}", "-o", "a.gif", "--fps", "1000"], "1000 frames per second"),
        (["animate", "{run}", "-o", "a.avi"], ".gif or .mp4"),
        (["report", "{run}", "-o", "r.doc"], ".html"),
    ],
)
def test_wrong_usage_is_one_line(
    denoised: Run,
    tmp_path: Path,
    arguments: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = denoised.folder / "input.ply"
    with pytest.raises(SystemExit) as ended:
        main([argument.format(run=denoised.folder, mesh=mesh) for argument in arguments])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert words in said
