"""One training step that is recorded once and replayed from then on.

A GPU is done with most of a step's several hundred calls sooner than Python can make them. As a CUDA graph all of them are
sent off in one call (PyTorch, "CUDA semantics", section "CUDA Graphs", capture of a whole network). What a step may do
then: read and write tensors that stay in their places, and nothing that depends on a number which only Python knows, or that
Python would have to wait for.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

import torch
from torch import Tensor

Step: TypeAlias = Callable[[], Mapping[str, Tensor]]

# Steps that are done as usual before one is recorded: libraries make their workspaces in them, the optimiser its means.
WARM_UP = 3
# Only one recording may be under way in a process.
_RECORDING = threading.Lock()


class Recorder(Protocol):
    """What does a step, records it, and does it again."""

    def do(self, step: Step) -> Mapping[str, Tensor]:
        """Do a step as usual, in the surroundings in which it will be recorded."""

    def record(self, step: Step) -> Mapping[str, Tensor]:
        """Record a step without doing it; whatever has been recorded before is forgotten.

        Returns:
            The step's results: tensors that hold nothing yet, and that each replay writes.

        Raises:
            RuntimeError: when something in the step cannot be recorded. No tensor that was there before has changed.
        """

    def replay(self) -> None:
        """Do the recorded step."""

    def forget(self) -> None:
        """Give back what the recording holds, once all that was replayed is done."""


class CapturedStep:
    """Does training steps: the first few as usual, then one that it records, by which it does all others.

    Each call is one training step; none is done twice or thrown away. A call's results are overwritten by the next.

    Attributes:
        refusal: why the step could not be recorded, so that all go on as usual; None where it could, or was not tried yet.
    """

    def __init__(self, step: Step, recorder: Recorder, forget_gradients: Callable[[], None]) -> None:
        """Make ready for a training that stands at any step.

        Args:
            step: does one training step and returns its results.
            recorder: how it is recorded.
            forget_gradients: lets go of the gradients, so that a recording makes its own, in a place that stays.
        """
        self.refusal: str | None = None
        self._step = step
        self._recorder = recorder
        self._forget_gradients = forget_gradients
        self._n_done = 0
        self._results: Mapping[str, Tensor] | None = None

    def __call__(self) -> Mapping[str, Tensor]:
        """Do one step and return its results."""
        if self._results is None and self.refusal is None and self._n_done >= WARM_UP:
            self._record()
        if self._results is not None:
            self._recorder.replay()
            return self._results
        if self.refusal is not None:
            return self._step()
        results = self._recorder.do(self._step)
        self._n_done += 1
        return results

    def _record(self) -> None:
        self._forget_gradients()
        try:
            self._results = self._recorder.record(self._step)
        # Whatever it is: nothing has been done yet, and if it is no matter of recording, the step as usual will say so.
        except Exception as error:
            self.refusal = " ".join(str(error).split())[:200] or type(error).__name__
        finally:
            if self._results is None:
                # Those of a recording that broke off lie in memory that goes with it.
                self._forget_gradients()
                self._recorder.forget()


class CudaGraphRecorder:
    """Records steps as CUDA graphs."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._stream: torch.cuda.Stream | None = None
        self._graph: torch.cuda.CUDAGraph | None = None

    def do(self, step: Step) -> Mapping[str, Tensor]:
        """See :meth:`Recorder.do`."""
        # On the stream of the recording: automatic derivatives and cuBLAS remember the stream that they first met.
        with torch.cuda.device(self._device):
            stream, current = self._own_stream(), torch.cuda.current_stream()
            stream.wait_stream(current)
            try:
                with torch.cuda.stream(stream):
                    return step()
            finally:
                current.wait_stream(stream)

    def record(self, step: Step) -> Mapping[str, Tensor]:
        """See :meth:`Recorder.record`."""
        self.forget()
        graph = torch.cuda.CUDAGraph()
        # Not by torch.cuda.graph, which may look for Python's garbage: a window must not be destroyed in this thread.
        with _RECORDING, torch.cuda.device(self._device):
            torch.cuda.synchronize()
            # The recording has memory of its own, and what the steps before have left would lie idle beside it.
            torch.cuda.empty_cache()
            with torch.cuda.stream(self._own_stream()):
                # What other threads do on a GPU meanwhile is theirs, and no reason to break off.
                graph.capture_begin(capture_error_mode="thread_local")
                try:
                    results = step()
                except BaseException:
                    # The stream must not be left recording; that there is nothing good to end is known.
                    with contextlib.suppress(RuntimeError):
                        graph.capture_end()
                    raise
                graph.capture_end()
        self._graph = graph
        return results

    def replay(self) -> None:
        """See :meth:`Recorder.replay`."""
        if self._graph is None:
            raise RuntimeError("There is no recorded step to replay.")
        # On the current stream, so that whoever looks at the results afterwards waits for them.
        self._graph.replay()

    def forget(self) -> None:
        """See :meth:`Recorder.forget`."""
        graph, self._graph = self._graph, None
        if graph is None:
            return
        # After an error of the device both fail, and it is that error which must be heard.
        with contextlib.suppress(RuntimeError):
            torch.cuda.synchronize(self._device)
        with contextlib.suppress(RuntimeError):
            graph.reset()

    def _own_stream(self) -> torch.cuda.Stream:
        if self._stream is None:
            self._stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        return self._stream
