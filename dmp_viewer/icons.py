"""Small line icons, drawn as SVG in the colour of the text, so that they fit both themes and every scale."""

from __future__ import annotations

from qtpy.QtCore import QByteArray, QRectF, Qt
from qtpy.QtGui import QColor, QIcon, QPainter, QPixmap
from qtpy.QtSvg import QSvgRenderer

from dmp_viewer.theme import Theme

# 24 x 24 drawings; "solid" ones are filled, all others are strokes of width 1.8.
_SHAPES: dict[str, str] = {
    "open": '<path d="M3 19V6h6l2 2h8v3"/><path d="M3 19l3-8h16l-3 8z"/>',
    "save": '<path d="M12 4v11"/><path d="M7.5 10.5L12 15l4.5-4.5"/><path d="M4 17v3h16v-3"/>',
    "export": '<path d="M12 15V4"/><path d="M7.5 8.5L12 4l4.5 4.5"/><path d="M5 11v9h14v-9"/>',
    "camera": '<path d="M3 8h4l2-3h6l2 3h4v11H3z"/><circle cx="12" cy="13" r="3.6"/>',
    "edges": '<path d="M12 3L3.5 8v8.5L12 21l8.5-4.5V8z"/>'
    '<path d="M12 3v9.5M3.5 8l8.5 4.5L20.5 8M12 12.5L3.5 16.5M12 12.5l8.5 4M12 12.5V21"/>',
    "link": '<path d="M10 14a4.5 4.5 0 0 0 6.4 0l3-3A4.5 4.5 0 0 0 13 4.6l-1.5 1.5"/>'
    '<path d="M14 10a4.5 4.5 0 0 0-6.4 0l-3 3A4.5 4.5 0 0 0 11 19.4l1.5-1.5"/>',
    "filling": '<circle cx="12" cy="12" r="8.5" stroke-dasharray="3 2.6"/><circle class="solid" cx="12" cy="12" r="4.2"/>',
    "fit": '<path d="M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5"/><circle cx="12" cy="12" r="3"/>',
    "play": '<path class="solid" d="M7 4.5v15l12.5-7.5z"/>',
    "pause": '<path class="solid" d="M6 5h4v14H6zM14 5h4v14h-4z"/>',
    "stop": '<path class="solid" d="M6 6h12v12H6z"/>',
    "first": '<path d="M6 5v14"/><path class="solid" d="M18 5.5v13L8.5 12z"/>',
    "previous": '<path class="solid" d="M17 5v14L6 12z"/>',
    "next": '<path class="solid" d="M7 5v14l11-7z"/>',
    "last": '<path d="M18 5v14"/><path class="solid" d="M6 5.5v13l9.5-6.5z"/>',
    "follow": '<path d="M4 12h12"/><path d="M11 6.5l5.5 5.5-5.5 5.5"/><path d="M20 5v14"/>',
    "keep": '<path d="M7 3.5h10v17l-5-4.2-5 4.2z"/>',
    "kept": '<path class="solid" d="M7 3.5h10v17l-5-4.2-5 4.2z"/>',
    "close": '<path d="M6 6l12 12M18 6L6 18"/>',
    "info": '<circle cx="12" cy="12" r="8.5"/><path d="M12 11v5.5M12 7.5v.6"/>',
    "warning": '<path d="M12 4L2.8 20h18.4z"/><path d="M12 10v5M12 17.2v.5"/>',
    "error": '<circle cx="12" cy="12" r="8.5"/><path d="M9 9l6 6M15 9l-6 6"/>',
    "success": '<circle cx="12" cy="12" r="8.5"/><path d="M8 12.3l2.8 2.8L16 9.5"/>',
    "right": '<path d="M9 5.5l6.5 6.5L9 18.5"/>',
    "down": '<path d="M5.5 9l6.5 6.5L18.5 9"/>',
    "smooth": '<circle cx="12" cy="12" r="8.5"/>'
    '<path class="solid" d="M12 3.5a8.5 8.5 0 0 1 0 17c3-2 4.5-5 4.5-8.5S15 5.5 12 3.5z"/>',
    "flip": '<path d="M4 8.5h13M13 4l4.5 4.5L13 13"/><path d="M20 16H7M11 11.5L6.5 16l4.5 4.5"/>',
    "swipe": '<path d="M12 3v18"/><path d="M4 5h8v14H4z"/><path class="solid" d="M12 5h8v14h-8z"/>',
    "lens": '<circle cx="10.5" cy="10.5" r="6.5"/><path d="M15.5 15.5L21 21"/>',
    "bookmark": '<path d="M7 3v18"/><path class="solid" d="M7 4h11l-3 4 3 4H7z"/>',
    "runs": '<path d="M9 6h12M9 12h12M9 18h12"/><path class="solid" d="M3 4.5h3.4v3H3zM3 10.5h3.4v3H3zM3 16.5h3.4v3H3z"/>',
    "queue": '<path d="M4 6h10M4 12h10M4 18h6"/><path d="M18 10v10M13.5 15.5L18 20l4.5-4.5"/>',
    "up": '<path d="M5.5 15l6.5-6.5 6.5 6.5"/>',
    "clock": '<circle cx="12" cy="12" r="8.5"/><path d="M12 7v5.3l3.4 2.2"/>',
    "window": '<path d="M4 8h12v12H4z"/><path d="M8 8V4h12v12h-4"/>',
    "trash": '<path d="M4 6.5h16M9 6V4h6v2M6 6.5l1 14h10l1-14M10 10.5v6M14 10.5v6"/>',
    "help": '<circle cx="12" cy="12" r="8.5"/><path d="M9.5 9.5a2.5 2.5 0 1 1 3.5 2.3c-.7.3-1 .8-1 1.7v.5M12 16.8v.5"/>',
}  # fmt: skip


def names() -> list[str]:
    """Return the names of all icons."""
    return list(_SHAPES)


def pixmap(name: str, color: QColor | str, size: int = 16, ratio: float = 1.0) -> QPixmap:
    """Draw an icon in one colour, ``size`` device-independent pixels wide on a screen with ``ratio`` pixels for each."""
    ink = QColor(color)
    paint = f'stroke="{ink.name()}" stroke-opacity="{ink.alphaF():.3f}"'
    fill = f'fill="{ink.name()}" fill-opacity="{ink.alphaF():.3f}" stroke="none"'
    shapes = _SHAPES[name].replace('class="solid"', fill)
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 24 24">'
        f'<g fill="none" {paint} stroke-width="1.8" stroke-linecap="round" stroke-linejoin="round">{shapes}</g></svg>'
    )
    result = QPixmap(round(size * ratio), round(size * ratio))
    result.fill(Qt.GlobalColor.transparent)
    painter = QPainter(result)
    QSvgRenderer(QByteArray(svg.encode())).render(painter, QRectF(result.rect()))
    painter.end()
    result.setDevicePixelRatio(ratio)
    return result


def icon(name: str, theme: Theme, *, color: str | None = None) -> QIcon:
    """Return an icon in the colours of a theme, normal and disabled, for screens of single and double density."""
    result = QIcon()
    for ratio in (1.0, 2.0):
        for size in (16, 20, 24):
            result.addPixmap(pixmap(name, color or theme.text, size, ratio), QIcon.Mode.Normal)
            result.addPixmap(pixmap(name, theme.faded, size, ratio), QIcon.Mode.Disabled)
    return result
