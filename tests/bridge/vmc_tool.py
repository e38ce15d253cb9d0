"""An animation tool's ear: what it hears over VMC."""

import threading

from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_server import BlockingOSCUDPServer

from services.bridge.humanoid import BONES, Bone


class Tool:
    """Listens as an animation tool does; frames as they came, in parts by address."""

    def __init__(self) -> None:
        self.said: list[tuple[str, tuple[object, ...]]] = []
        dispatcher = Dispatcher()
        dispatcher.set_default_handler(lambda address, *values: self.said.append((address, values)))
        self._server = BlockingOSCUDPServer(("127.0.0.1", 0), dispatcher)
        self.port = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def oks(self) -> list[tuple[object, ...]]:
        return [values for address, values in list(self.said) if address == "/VMC/Ext/OK"]

    def frames(self) -> dict[float, list[Bone]]:
        """The bones of whole frames by their time."""
        found: dict[float, list[Bone]] = {}
        bones: list[Bone] = []
        for address, values in list(self.said):
            if address == "/VMC/Ext/T":
                bones = found.setdefault(round(float(str(values[0])), 3), [])
            elif address == "/VMC/Ext/Bone/Pos":
                numbers = tuple(float(str(value)) for value in values[1:])
                bones.append(Bone(str(values[0]), numbers[:3], numbers[3:]))
        return {time_s: bones for time_s, bones in found.items() if len(bones) == len(BONES)}
