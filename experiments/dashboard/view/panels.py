"""How wide the panels beside the 3-D view are: on a page in a small window, what they can spare is
the view's."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle

# Chosen: curves and words are read well in the first widths and fit the second ones, and labels in
# the 3-D view lie over one another where it is narrower than that.
WIDE_PX, SPARE_PX, SMALL_VIEW_PX = (330, 390), (260, 350), 400


@dataclass(frozen=True)
class Panels:
    """The panels of viser at the left and at the right."""

    left: Any
    right: Any

    def widen(self) -> None:
        """Give them their widths on every page."""
        for panel, width_px in zip((self.left, self.right), WIDE_PX, strict=True):
            panel.set_width(width_px)

    def fit(self, client: "ClientHandle") -> None:
        """Narrow them on one page as soon as its 3-D view is small; a person may widen them."""
        narrowed = False

        async def narrow(camera: "CameraHandle") -> None:
            nonlocal narrowed
            if not narrowed and 0 < camera.image_width < SMALL_VIEW_PX:
                narrowed = True
                for panel, width_px in zip((self.left, self.right), SPARE_PX, strict=True):
                    tell_width(client, panel, width_px)

        client.camera.on_update(narrow)


def tell_width(client: "ClientHandle", panel: Any, width_px: int) -> None:
    """Give a panel of all pages another width on one page."""
    from viser._messages import GuiSetPanelWidthMessage

    api, place = panel._placement_gui_api, panel._placement_uuid
    number = api._next_layout_counter()
    message = GuiSetPanelWidthMessage(place, width_px, number, api._layout_run_id)
    client._websock_connection.queue_message(message)
