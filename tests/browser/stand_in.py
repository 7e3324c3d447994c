"""A live view without a run: speaks the page's protocol, and sends each frame on a test's request.

The real one is tested against the real page in test_run.py; this one can delay and drop frames,
refuse requests and close streams on a test's request.
"""

import copy
import json
import queue
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

TOKEN = "0123456789abcdef"


class StandIn:
    """Serves one page, streams the events passed to `send`, and keeps posted requests."""

    def __init__(self, html, frames):
        self.html = html
        self.frames = copy.deepcopy(frames)
        self.posted = []
        self.refusal = None
        self.connections = 0
        self.step = 0
        self.state = {}
        self.streams = []
        self.lock = threading.Lock()
        stand_in = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                if self.path == f"/?token={TOKEN}":
                    self.answer(200, stand_in.html.encode(), "text/html; charset=utf-8")
                elif self.path == f"/events?token={TOKEN}":
                    self.stream()
                else:
                    self.answer(403, b"wrong token", "text/plain")

            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                kind = self.headers["Content-Type"]
                stand_in.posted.append((self.path, kind, json.loads(body)))
                if stand_in.refusal:
                    self.answer(409, stand_in.refusal.encode(), "text/plain")
                    return
                stand_in.act(json.loads(body))
                self.answer(204, b"", "text/plain")

            def answer(self, code, body, kind):
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def stream(self):
                lines = queue.Queue()
                with stand_in.lock:
                    stand_in.connections += 1
                    stand_in.streams.append(lines)
                self.send_response(200)
                self.send_header("Content-Type", "text/event-stream")
                self.end_headers()
                # The client reconnects soon.
                self.wfile.write(b"retry: 200\n\n")
                while (text := lines.get()) is not None:
                    self.wfile.write(text.encode())
                    self.wfile.flush()

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.address = f"http://127.0.0.1:{self.server.server_port}/?token={TOKEN}"

    def act(self, body):
        states = {"kill": "dead", "freeze": "frozen", "thaw": "moving", "restart": "moving"}
        if body["act"] in states:
            self.state[body["robot"]] = states[body["act"]]

    def send(self, event, data):
        with self.lock:
            for lines in self.streams:
                lines.put(f"event: {event}\ndata: {json.dumps(data)}\n\n")

    def frame(self, names, behind_ms=0.0, dropped=0):
        """Sends the next frame, with the current states of the robots."""
        frame = copy.deepcopy(self.frames[self.step % len(self.frames)])
        self.step += 1
        for robot, name in zip(frame["robots"], names):
            robot["state"] = self.state.get(name, "moving")
        frame |= {"behind_ms": behind_ms, "dropped": dropped}
        self.send("message", frame)
        return frame

    def break_off(self):
        """Closes all streams, as a network failure does."""
        with self.lock:
            for lines in self.streams:
                lines.put(None)
            self.streams.clear()

    def close(self):
        self.break_off()
        self.server.shutdown()
        self.server.server_close()
