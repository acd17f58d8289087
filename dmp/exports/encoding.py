"""Pictures and animations as files: PNG and JPEG, GIF by Pillow, MP4 by ffmpeg where there is one."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from PIL import Image

from dmp.errors import DmpError
from dmp.exports.scenes import Sheet

NO_FFMPEG = (
    "MP4 needs the program ffmpeg, which was not found. Install it with 'pip install imageio-ffmpeg', or choose GIF, which "
    "always works."
)
# A colour table shared by all frames does not flicker; so many of them decide on it.
_SAMPLES = 6
_GIF_HUNDREDTHS = 100


class Encoder(Protocol):
    """Takes pictures one after the other."""

    def add(self, picture: Image.Image) -> None:
        """Take the next one."""

    def finish(self) -> list[Path]:
        """Write what is left, and return the files."""


class PictureFiles:
    """Each picture becomes a file ``000000.png`` or ``000000.jpg``."""

    def __init__(self, folder: Path, sheet: Sheet) -> None:
        self._folder, self._kind = folder, sheet.kind
        self._written: list[Path] = []

    def add(self, picture: Image.Image) -> None:
        """Write the next one."""
        path = self._folder / f"{len(self._written):06d}.{self._kind}"
        if self._kind == "jpg":
            picture.convert("RGB").save(path, quality=93)
        else:
            # The default takes three times as long for a tenth less.
            picture.save(path, compress_level=4)
        self._written.append(path)

    def finish(self) -> list[Path]:
        """Return the files."""
        return self._written


class GifFile:
    """All pictures become one GIF that repeats for ever."""

    def __init__(self, folder: Path, sheet: Sheet) -> None:
        self._folder, self._sheet = folder, sheet
        # Waiting for the colours that suit all of them, they take less room on the disk than in memory.
        self._frames: list[Path] = []

    def add(self, picture: Image.Image) -> None:
        """Take the next one."""
        path = self._folder / f"frame{len(self._frames):06d}.png"
        picture.convert("RGB").save(path, compress_level=1)
        self._frames.append(path)

    def finish(self) -> list[Path]:
        """Reduce the colours and write the file."""
        sheet, path = self._sheet, self._folder / "animation.gif"
        palette = _shared_palette(self._frames)

        def reduced() -> Iterator[Image.Image]:
            for frame in self._frames:
                with Image.open(frame) as picture:
                    yield picture.quantize(palette=palette, dither=Image.Dither.NONE)

        # GIF counts in hundredths of a second, and browsers slow down below two.
        each = max(2, round(_GIF_HUNDREDTHS / sheet.frames_per_second))
        durations = [10 * each] * len(self._frames)
        durations[-1] += round(1000 * sheet.hold_seconds)
        pictures = reduced()
        first = next(pictures)
        first.save(path, save_all=True, append_images=pictures, duration=durations, loop=0, optimize=False, disposal=1)
        return [path]


class Mp4File:
    """All pictures become one MP4 (H.264), which every browser and office program plays."""

    def __init__(self, folder: Path, sheet: Sheet) -> None:
        program = find_ffmpeg()
        if program is None:
            raise DmpError(NO_FFMPEG)
        self._path = folder / "animation.mp4"
        self._errors = folder / "ffmpeg.txt"
        self._hold = round(sheet.hold_seconds * sheet.frames_per_second)
        self._last: bytes = b""
        command = [
            program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{sheet.width}x{sheet.height}",
            "-r", f"{sheet.frames_per_second:g}", "-i", "-", "-an", "-c:v", "libx264", "-preset", "medium", "-crf", "17",
            "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(self._path),
        ]  # fmt: skip
        with self._errors.open("wb") as said:
            self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said)

    def add(self, picture: Image.Image) -> None:
        """Hand over the next one."""
        self._last = picture.convert("RGB").tobytes()
        self._write(self._last)

    def finish(self) -> list[Path]:
        """Let the last one stay, and wait for the file."""
        for _ in range(self._hold):
            self._write(self._last)
        assert self._child.stdin is not None
        self._child.stdin.close()
        if self._child.wait() or not self._path.is_file():
            raise DmpError(self._why())
        return [self._path]

    def _write(self, content: bytes) -> None:
        assert self._child.stdin is not None
        try:
            self._child.stdin.write(content)
        except OSError as error:
            self._child.wait()
            raise DmpError(self._why()) from error

    def _why(self) -> str:
        lines = self._errors.read_text(errors="replace").strip().splitlines()
        said = lines[-1].strip().rstrip(".") if lines else "it gave no reason"
        return f"ffmpeg could not make the MP4 ({said}). Choose GIF, which always works."


def encoder(folder: Path, sheet: Sheet) -> Encoder:
    """Return what writes the files of an export into a folder (raises :class:`DmpError` when MP4 cannot be made)."""
    made: dict[str, type[GifFile] | type[Mp4File]] = {"gif": GifFile, "mp4": Mp4File}
    return made.get(sheet.kind, PictureFiles)(folder, sheet)


def find_ffmpeg() -> str | None:
    """Return the ffmpeg that comes with the package imageio-ffmpeg, else that of the system; None without any."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError, OSError):
        return shutil.which("ffmpeg")


def _shared_palette(frames: Sequence[Path]) -> Image.Image:
    """Return a picture with the 256 colours that suit all frames best."""
    chosen = [frames[index] for index in np.unique(np.linspace(0, len(frames) - 1, _SAMPLES).round().astype(int))]
    samples = []
    for path in chosen:
        with Image.open(path) as frame:
            width = min(frame.width, 640)
            samples.append(frame.resize((width, round(frame.height * width / frame.width)), Image.Resampling.NEAREST))
    width, height = samples[0].size
    joined = Image.new("RGB", (width, height * len(samples)))
    for number, sample in enumerate(samples):
        joined.paste(sample, (0, number * height))
    return joined.quantize(256, method=Image.Quantize.MEDIANCUT, kmeans=1)
