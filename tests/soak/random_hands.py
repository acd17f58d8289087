"""Hands that do anything in a window, by chance: what a person may do, in an order that nobody would think of."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from qtpy.QtCore import QPoint, QPointF, Qt, QTimer
from qtpy.QtGui import QAction, QDesktopServices, QDrag, QWheelEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QAbstractButton, QApplication, QDialog, QFileDialog, QLineEdit, QMenu, QWidget

from dmp_viewer.controller import Controller
from tests.soak.window_child import pump, quick

_KEYS = [
    *(Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Home, Qt.Key.Key_End, Qt.Key.Key_Space, Qt.Key.Key_Escape, Qt.Key.Key_Tab),
    *(Qt.Key.Key_Return, Qt.Key.Key_Delete, Qt.Key.Key_Backspace, Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_PageUp),
    *(Qt.Key(code) for code in (*range(ord("0"), ord("9") + 1), *range(ord("A"), ord("Z") + 1))),
    *(Qt.Key(Qt.Key.Key_F1.value + number) for number in range(12)),
]
_MODIFIERS = [Qt.KeyboardModifier.NoModifier] * 6 + [
    Qt.KeyboardModifier.ShiftModifier,
    Qt.KeyboardModifier.ControlModifier,
    Qt.KeyboardModifier.AltModifier,
]
_LONGEST_DRAG_MS = 300
_BUTTONS = [Qt.MouseButton.LeftButton] * 6 + [Qt.MouseButton.RightButton, Qt.MouseButton.MiddleButton]
# How often what is done, among a hundred.
_SHARES = {
    "action": 37, "click": 22, "double click": 3, "drag": 5, "wheel": 4, "key": 9, "type": 2, "open": 4, "drop": 2, "train": 4,
    "stop": 2, "resize": 2, "settings": 2, "close": 1, "vanish": 1,
}  # fmt: skip


class Hands:
    """Does what :meth:`choose` says, and answers whatever opens.

    Args:
        generator: of all chance.
        samples: mesh files to open.
        folder: where files are saved, and the only place where anything is deleted.
    """

    def __init__(self, generator: np.random.Generator, samples: list[Path], folder: Path) -> None:
        self._random = generator
        self._samples = samples
        self._folder = folder
        # Whether a dialog asks at this moment depends on the training, and must not change what is done next.
        self._answers = np.random.default_rng(generator.integers(1 << 32))
        self._answer_file_dialogs()
        self._timer = QTimer()
        self._timer.setInterval(40)
        self._timer.timeout.connect(self._answer)
        self._timer.start()

    def choose(self) -> str:
        """Return what to do next."""
        names = list(_SHARES)
        shares = np.array([_SHARES[name] for name in names], dtype=float)
        return str(self._random.choice(names, p=shares / shares.sum()))

    def act(self, controller: Controller, what: str) -> None:
        """Do it."""
        getattr(self, f"_{what.replace(' ', '_')}")(controller)

    def _one(self, items: list[Any]) -> Any:
        return items[int(self._random.integers(len(items)))]

    def _tell(self, what: str) -> None:
        print(json.dumps({"begun": what}), flush=True)

    # -- actions, buttons, keys ---------------------------------------------------------------------------------------

    def _action(self, controller: Controller) -> None:
        possible = [
            action
            for action in controller.window.findChildren(QAction)
            if action.isEnabled() and action.objectName() not in ("", "quit") and action.menu() is None
        ]
        action = self._one(possible)
        self._tell(action.objectName())
        action.trigger()

    def _widget(self, controller: Controller) -> tuple[QWidget, QPoint]:
        """Return a widget on show, mostly of the window, and a place in it."""
        windows = [widget for widget in QApplication.topLevelWidgets() if widget.isVisible() and not isinstance(widget, QMenu)]
        window = controller.window if self._random.random() < 0.8 or not windows else self._one(windows)
        widgets = [widget for widget in window.findChildren(QWidget) if widget.isVisible() and widget.isEnabled()]
        widget = self._one(widgets) if widgets else window
        place = QPoint(*(int(self._random.integers(max(1, length))) for length in (widget.width(), widget.height())))
        return widget, place

    def _described(self, widget: QWidget) -> str:
        text = widget.text() if isinstance(widget, QAbstractButton) else ""
        return f"{type(widget).__name__} {widget.objectName()} {text}".strip()

    def _click(self, controller: Controller) -> None:
        widget, place = self._widget(controller)
        self._tell(f"click on {self._described(widget)}")
        QTest.mouseClick(widget, self._one(_BUTTONS), self._one(_MODIFIERS), place)

    def _double_click(self, controller: Controller) -> None:
        widget, place = self._widget(controller)
        self._tell(f"double click on {self._described(widget)}")
        QTest.mouseDClick(widget, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, place)

    def _drag(self, controller: Controller) -> None:
        widget, place = self._widget(controller)
        self._tell(f"drag in {self._described(widget)}")
        button = self._one(_BUTTONS)
        # A drag of rows has an event loop of its own, which ends by the real mouse alone.
        end_of_drag = QTimer()
        end_of_drag.timeout.connect(QDrag.cancel)
        end_of_drag.start(_LONGEST_DRAG_MS)
        QTest.mousePress(widget, button, Qt.KeyboardModifier.NoModifier, place)
        for _ in range(int(self._random.integers(1, 6))):
            place += QPoint(*(int(step) for step in self._random.integers(-60, 61, 2)))
            QTest.mouseMove(widget, place)
            pump(0.0)
        QTest.mouseRelease(widget, button, Qt.KeyboardModifier.NoModifier, place)
        end_of_drag.stop()

    def _wheel(self, controller: Controller) -> None:
        widget, place = self._widget(controller)
        self._tell(f"wheel over {self._described(widget)}")
        turn = QPoint(0, int(self._random.choice([-240, -120, 120, 240])))
        where = QPointF(place)
        event = QWheelEvent(
            where, QPointF(widget.mapToGlobal(place)), QPoint(), turn, Qt.MouseButton.NoButton, self._one(_MODIFIERS),
            Qt.ScrollPhase.NoScrollPhase, False,
        )  # fmt: skip
        QApplication.sendEvent(widget, event)

    def _key(self, controller: Controller) -> None:
        key, modifier = self._one(_KEYS), self._one(_MODIFIERS)
        if (key, modifier) == (Qt.Key.Key_Q, Qt.KeyboardModifier.ControlModifier):
            return
        widget = QApplication.focusWidget() or controller.window
        self._tell(f"key {key.name} with {modifier.name} in {self._described(widget)}")
        QTest.keyClick(widget, key, modifier)

    def _type(self, controller: Controller) -> None:
        fields = [field for field in controller.window.findChildren(QLineEdit) if field.isVisible() and field.isEnabled()]
        if not fields:
            return
        field = self._one(fields)
        text = str(self._one(["0", "-1", "1e9", "0.5", "", "abc", "nan", "3,5", "ö ", "99999999999999999999", "7"]))
        self._tell(f"type {text!r} into {self._described(field)}")
        field.selectAll()
        field.insert(text)  # QTest itself ends the process at a letter that is not ASCII
        field.textEdited.emit(field.text())
        QTest.keyClick(field, Qt.Key.Key_Return)

    # -- files, trainings, the window ---------------------------------------------------------------------------------

    def _path(self) -> Path:
        runs = sorted((self._folder / "runs").glob("*"))
        saved = sorted((self._folder / "saved").glob("*"))
        good, any_of_them = self._samples[:4], [*self._samples, *runs, *saved]
        path: Path = self._one(good if self._random.random() < 0.5 else any_of_them)
        return path

    def _open(self, controller: Controller) -> None:
        path = self._path()
        self._tell(f"open {path.name}")
        controller.opener.open_path(path)

    def _drop(self, controller: Controller) -> None:
        paths = [self._path() for _ in range(int(self._random.integers(1, 4)))]
        self._tell(f"drop {[path.name for path in paths]}")
        controller.window.filesDropped.emit(paths)

    def _train(self, controller: Controller) -> None:
        preset = str(self._one(["compact", "compact", "best"]))
        task = controller.opener.settings_for_opening().task
        steps = int(self._one([6, 20, 2000]))
        self._tell(f"train {task} {preset} for {steps} steps")
        if not controller.runner.state.is_active:
            controller.window.panel.set_settings(quick(task=task, preset=preset, steps=steps))
        controller.start()
        pump(float(self._random.uniform(0, 0.5)))

    def _stop(self, controller: Controller) -> None:
        controller.runner.stop()

    def _settings(self, controller: Controller) -> None:
        task = str(self._one(["denoise", "complete"]))
        self._tell(f"settings of {task}")
        controller.window.panel.set_settings(quick(task=task))

    def _resize(self, controller: Controller) -> None:
        controller.window.resize(int(self._random.integers(300, 1500)), int(self._random.integers(200, 950)))

    def _close(self, controller: Controller) -> None:
        controller.window.close()

    def _vanish(self, controller: Controller) -> None:
        """A run folder is deleted by somebody else."""
        runs = sorted((self._folder / "runs").glob("*"))
        if len(runs) > 3:
            shutil.rmtree(self._one(runs), ignore_errors=True)

    # -- answers ------------------------------------------------------------------------------------------------------

    def _answer(self) -> None:
        """Choose something in the menu or dialog that is open, or leave it."""
        menu, dialog = QApplication.activePopupWidget(), QApplication.activeModalWidget()
        if menu is not None:
            actions = [action for action in menu.actions() if action.isEnabled() and action.menu() is None]
            actions = [action for action in actions if action.objectName() != "quit"]
            menu.close()
            if actions and isinstance(menu, QMenu) and self._answers.random() < 0.5:
                actions[int(self._answers.integers(len(actions)))].trigger()
        elif dialog is not None:
            buttons = [button for button in dialog.findChildren(QAbstractButton) if button.isVisible() and button.isEnabled()]
            if buttons and self._answers.random() < 0.8:
                buttons[int(self._answers.integers(len(buttons)))].click()
            elif isinstance(dialog, QDialog):
                dialog.reject()
            else:
                dialog.close()

    def _answer_file_dialogs(self) -> None:
        """Choose files by chance without a dialog, in which chance could delete anything."""
        saved = self._folder / "saved"
        saved.mkdir(exist_ok=True)

        def of_a_dialog(choose: Callable[[], str]) -> Callable[..., tuple[str, str]]:
            return lambda *_, **__: (choose() if self._answers.random() < 0.8 else "", "")

        def opened() -> str:
            return str(self._samples[int(self._answers.integers(len(self._samples)))])

        def written() -> str:
            names = [
                "a.ply",
                "b.obj",
                "c.stl",
                "d.off",
                "e.vtp",
                "f.png",
                "g.csv",
                "h.json",
                "i.mp4",
                "j.gif",
                "k",
                "no/l.ply",
                "m.xyz",
            ]
            return str(saved / names[int(self._answers.integers(len(names)))])

        def folder(*_: object, **__: object) -> str:
            runs = [*sorted((self._folder / "runs").glob("*")), self._folder, saved]
            return str(runs[int(self._answers.integers(len(runs)))]) if self._answers.random() < 0.8 else ""

        for name, answer in (
            ("getOpenFileName", of_a_dialog(opened)),
            ("getOpenFileNames", lambda *_, **__: ([opened()], "")),
            ("getSaveFileName", of_a_dialog(written)),
            ("getExistingDirectory", folder),
        ):
            setattr(QFileDialog, name, staticmethod(answer))
        QDesktopServices.openUrl = staticmethod(lambda *_, **__: True)  # type: ignore[method-assign]
