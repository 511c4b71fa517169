"""Which messages of a page reach viser: values of inputs, presses, clicks, the page's view.

viser 1.1.1 (pinned) sets whatever attribute of an input a message names, and keeps uploads that
nothing asked for. Here nothing passes that is not on the list, and of an input only a value that
`Controls` has checked.
"""

from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

Handler = Callable[[Any, Any], Awaitable[None]]
LONGEST = 1 << 16  # bytes of a message; chosen: a page's own are shorter than 1 kB


def tell_page(client: "ClientHandle", handle: Any, **properties: Any) -> None:
    """Show an element of all pages with other properties (disabled, visible, value) on one page."""
    from viser import _messages as messages

    message = messages.GuiUpdateMessage(handle._impl.uuid, properties)
    client._websock_connection.queue_message(message)


def _of_any_shape(handler: Handler) -> Handler:
    """viser's handler, by which a message is passed over that is not what its kind says: it would
    tell of each in a traceback.
    """

    async def handle(page: Any, message: Any) -> None:
        with suppress(Exception):
            await handler(page, message)

    return handle


def admit_values(server: "ViserServer", controls: Controls) -> None:
    """Let pages press, click, look around, and set the inputs that `controls` knows.

    Called before anything is on the page; inputs of `server.gui` alone, none of a single page.
    """
    from viser import _messages as messages

    socket = server._websock_server
    handlers: Any = socket._incoming_handlers
    inputs = server.gui._gui_input_handle_from_uuid
    (store,) = handlers[messages.GuiUpdateMessage]

    async def update(page: Any, message: messages.GuiUpdateMessage) -> None:
        handle = inputs.get(message.uuid) if isinstance(message.uuid, str) else None
        updates = message.updates
        if handle is None or not isinstance(updates, dict) or list(updates) != ["value"]:
            return
        raw = updates["value"]
        try:
            value = controls.cleaned(page, handle, raw)
        except (ValueError, PermissionError) as error:
            controls.refuse(page, handle, error)
            value = handle.value
        else:
            if not controls.is_own(handle):  # viser would show it to every page
                await store(page, replace(message, updates={"value": value}))
            controls.use(page, handle, value)
        client = server._connected_clients.get(page)
        if value != raw and client is not None:  # the page shows what it asked for
            tell_page(client, handle, value=value)

    admitted = {
        messages.GuiUpdateMessage: [update],
        **{
            kind: [_of_any_shape(one) for one in handlers[kind]]
            for kind in (messages.CommandTriggerMessage, messages.ScenePointerMessage)
        },
    }
    handlers.clear()
    handlers.update(admitted)

    def admit_view(connection: Any) -> None:
        own = connection._incoming_handlers
        for kind in set(own) - {messages.ViewerCameraMessage}:
            del own[kind]

    socket.on_client_connect(admit_view)
