"""Serves an emulated camera as a Motion-JPEG stream over HTTP, to this computer only.

Like a network camera it sends each viewer the newest frame and skips what a slow viewer has no time for. A frame that
cannot be drawn in time is left out, so that readers can tell how old a frame may be: as the camera's own latency and
``on_time_s`` together.
"""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from rig.devices import Clock
from rig.errors import HardwareError
from sim_backends.camera_emulator import EmulatedCamera
from sim_backends.emulated_capture import EmulatedCapture

LOOPBACK = "127.0.0.1"
PATH = "/stream.mjpg"
ON_TIME_S = 0.1
_BOUNDARY = "frame"
_PAUSE_S = 0.05
_VIEWER_TIMEOUT_S = 5.0


class MjpegServer:
    """A stream on a port of the loopback interface, there is no way to ask for another. A context manager."""

    def __init__(
        self,
        camera: EmulatedCamera,
        clock: Clock,
        *,
        port: int = 0,
        quality: int = 95,
        on_time_s: float = ON_TIME_S,
    ) -> None:
        """Bind and serve.

        Args:
            camera: what is shown; nobody else may read it.
            clock: the real one; frames are drawn as its time passes.
            port: 0: any that is free.
            quality: of the JPEG files, 1..100. Below about 90 the noise goes, and a rig at rest looks frozen.
            on_time_s: longest time from a frame's arrival until it is drawn and coded.
        """
        self._camera, self._clock, self._quality, self._on_time_s = camera, clock, quality, on_time_s
        self._changed = threading.Condition()
        self._frame, self._number = b"", 0
        self._plugged = self._serving = True
        self._server = ThreadingHTTPServer((LOOPBACK, port), _handler_of(self))
        self._server.daemon_threads = True
        self._threads = [
            threading.Thread(target=self._pump, name="emulated camera", daemon=True),
            threading.Thread(target=self._server.serve_forever, args=(_PAUSE_S,), name="camera server", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def address(self) -> tuple[str, int]:
        """Interface and port that are listened on."""
        host, port = self._server.socket.getsockname()[:2]
        return str(host), int(port)

    @property
    def url(self) -> str:
        """Where the stream is."""
        return f"http://{LOOPBACK}:{self.address[1]}{PATH}"

    @property
    def plugged(self) -> bool:
        """The camera behind it is plugged in."""
        return self._plugged and self._serving

    def next_frame(self, after: int) -> tuple[int, bytes] | None:
        """The newest frame, as a JPEG file with its number, once that is above ``after``; ``None``: the stream ends."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > after or not self.plugged)
            return (self._number, self._frame) if self.plugged else None

    def close(self) -> None:
        """Stop serving. Safe to call twice."""
        if self._serving:
            with self._changed:
                self._serving = False
                self._changed.notify_all()
            self._server.shutdown()
            self._server.server_close()
            for thread in self._threads:
                thread.join()

    def __enter__(self) -> MjpegServer:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _pump(self) -> None:
        """Draw the camera's frames as they come; open it again when it is plugged in again."""
        capture: EmulatedCapture | None = None
        while self._serving:
            if capture is None:
                capture = self._opened()
            elif capture.frame_waiting(_PAUSE_S) and not self._serve_one(capture):
                capture = None

    def _opened(self) -> EmulatedCapture | None:
        try:
            capture = EmulatedCapture(self._camera, self._clock)
        except HardwareError:  # it is still unplugged, which is what viewers are told
            self._clock.sleep_s(_PAUSE_S)
            return None
        self._show(None, plugged=True)
        return capture

    def _serve_one(self, capture: EmulatedCapture) -> bool:
        """Show the next frame if that can be done in time; False: the camera is unplugged."""
        import cv2

        if not capture.grab() or capture.grabbed is None:
            self._show(None, plugged=False)
            return False
        until_s = capture.grabbed.arrived_s + self._on_time_s
        # Drawing frames that have waited long would let those behind them wait as long.
        if self._clock.now_s() < until_s - self._on_time_s / 2.0:
            image = capture.retrieve()[1]
            assert image is not None
            encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self._quality])[1].tobytes()
            if self._clock.now_s() <= until_s:
                self._show(encoded, plugged=True)
        return True

    def _show(self, frame: bytes | None, *, plugged: bool) -> None:
        with self._changed:
            self._plugged = plugged
            if frame is not None:
                self._frame, self._number = frame, self._number + 1
            self._changed.notify_all()


def _handler_of(stream: MjpegServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version = "emulated-camera"
        timeout = _VIEWER_TIMEOUT_S
        disable_nagle_algorithm = True

        def do_GET(self) -> None:
            """Send frames until the viewer has gone or the camera is unplugged."""
            try:
                self._answer()
            except OSError:
                self.close_connection = True  # the viewer has gone, or takes nothing any more

        def _answer(self) -> None:
            # A page that makes a browser believe its own name stands for this computer sends that name.
            if self.headers.get("Host", "").split(":")[0] not in (LOOPBACK, "localhost"):
                self.send_error(403, "This camera is shown to this computer only")
            elif self.path != PATH:
                self.send_error(404, f"The stream is at {PATH}")
            elif not stream.plugged:
                self.send_error(503, "The camera is unplugged")
            else:
                self._stream()

        def _stream(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            sent = 0
            while (following := stream.next_frame(sent)) is not None:
                sent, frame = following
                head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(frame)}\r\n\r\n"
                self.wfile.write(head.encode("ascii") + frame + b"\r\n")

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing: a viewer is no event."""

    return Handler
