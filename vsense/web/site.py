"""What lies at which address of the server, and what every answer carries for safety."""

from __future__ import annotations

import html
import re
from collections.abc import Awaitable, Callable
from pathlib import Path

from aiohttp import web

from vsense.hub import Hub
from vsense.orders import Give
from vsense.web.desk import Desk
from vsense.web.gate import Gate, Stranger
from vsense.web.tokens import Rights, Tokens

PAGE = Path(__file__).parent / "page"
VIEWERS_MAX = 64
"""Pages at once; a browser that opens them in a loop must not eat the machine."""
_FILE = re.compile(r"[a-z0-9_]+\.(?:js|css|svg)")
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'; "
        "base-uri 'none'; form-action 'self'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Site:
    """The page, its files and its WebSocket."""

    def __init__(self, hub: Hub, give: Give, host: str, port: int, tokens: Tokens | None) -> None:
        """Builds the application; the parameters are those of `WebServer`."""
        self._gate = Gate(host, port, tokens)
        self._desk = Desk(hub, give)
        self.app = web.Application(middlewares=[self._guard], client_max_size=4096)
        self.app.router.add_get("/", self._page)
        self.app.router.add_get("/ws", self._socket)
        self.app.router.add_get("/{name}", self._file)
        self.app.on_response_prepare.append(_protect)

    async def close(self) -> None:
        """Ends all conversations."""
        await self._desk.close()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuses what comes from elsewhere before anything else is looked at."""
        try:
            self._gate.check_host(request.headers)
            self._gate.check_origin(request.headers, needed=request.path == "/ws")
        except Stranger as reason:
            return _refusal(str(reason))
        try:
            return await handler(request)
        except ConnectionError:
            # It went before it got an answer: nobody will read this one either.
            return web.Response(status=400)

    def _rights(self, request: web.Request) -> Rights:
        return self._gate.rights(request.query.get("token"), request.cookies)

    async def _page(self, request: web.Request) -> web.StreamResponse:
        if self._rights(request) is Rights.NONE:
            given = "token" in request.query
            return _refusal(
                "this token is not the right one" if given else "this page needs a token", True
            )
        answer = web.Response(body=(PAGE / "index.html").read_bytes(), content_type="text/html")
        answer.charset = "utf-8"
        token = request.query.get("token")
        if token is not None and self._gate.needs_token:
            # Not by a redirect: browsers would not send the strict cookie along with one that
            # began on another site, such as a chat in which the address was passed on.
            answer.set_cookie(self._gate.cookie, token, httponly=True, samesite="Strict", path="/")
        return answer

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        rights = self._rights(request)
        if rights is Rights.NONE:
            return _refusal("this page needs a token", True)
        if self._desk.viewers >= VIEWERS_MAX:
            return _refusal(f"{VIEWERS_MAX} pages are open already: close one", status=503)
        return await self._desk.serve(request, rights)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        path = PAGE / name
        if _FILE.fullmatch(name) is None or not path.is_file():
            return _refusal(f"there is no '{name:.80}' here", status=404)
        answer = web.Response(body=path.read_bytes(), content_type=_TYPES[path.suffix])
        answer.charset = "utf-8"
        return answer


async def _protect(request: web.Request, response: web.StreamResponse) -> None:
    """What every answer tells the browser."""
    response.headers.update(_HEADERS)


def _refusal(reason: str, token: bool = False, status: int = 403) -> web.Response:
    """A page that says why not, and asks for a token where one would help."""
    form = (PAGE / "token_form.html").read_text(encoding="utf-8") if token else ""
    page = (PAGE / "refusal.html").read_text(encoding="utf-8")
    words = html.escape(reason[:1].upper() + reason[1:])
    text = page.replace("{reason}", words).replace("{form}", form)
    return web.Response(text=text, status=status, content_type="text/html")
