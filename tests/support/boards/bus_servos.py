"""Bus servos as their makers' documents have them, written without a line of the drivers.

A bus takes bytes (`receive`), lets its servos turn (`step`) and gives bytes (`take`). Feetech:
Communication Protocol User Manual (FT-SCS) and the STS3215 memory table; Dynamixel: ROBOTIS
e-Manual, Protocol 2.0, CRC Calculation and the XL430-W250's control table.
"""

from collections import deque
from collections.abc import Callable
from math import exp

LAG_S, DEAD_TIME_S = 0.0347, 0.0155  # of an STS3215, as measured by owners
TOP_COUNTS_S = 3063.0  # 4.7 rad/s
PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 1, 2, 3, 0x82, 0x83


class Servo:
    """Registers and motion of one servo; `counts` is where its shaft is. held: a hand holds it."""

    def __init__(self, servo_id: int, counts: float = 2048.0) -> None:
        self.servo_id, self.counts, self.held = servo_id, counts, False
        self.memory = bytearray(256)
        self.alarm, self.gone = 0, False
        self._goals: deque[float] = deque([counts] * max(1, round(1e3 * DEAD_TIME_S)))

    def put(self, address: int, value: int, length: int) -> None:
        self.memory[address : address + length] = value.to_bytes(length, "little", signed=value < 0)

    def get(self, address: int, length: int) -> int:
        return int.from_bytes(self.memory[address : address + length], "little")

    def turn(self, torque: bool, goal: float, top_counts_s: float) -> None:
        """One millisecond of dead time, lag and rate limit; without torque gears hold the arm."""
        self._goals.append(goal if torque else self.counts)
        due = self._goals.popleft()
        if not torque or self.held:
            return
        wish = (due - self.counts) * (1.0 - exp(-1e-3 / LAG_S))
        most = 1e-3 * min(top_counts_s, TOP_COUNTS_S)
        self.counts += max(-most, min(most, wish))


class Bus:
    """What both makers' buses share: the servos, and what a test may do to the answers.

    spoil: called with each answer, gives what arrives of it; late_ms: how much later answers come.
    heard: every instruction (id, number, parameters) that was whole.
    """

    def __init__(self, servos: list[Servo]) -> None:
        self.servos = {servo.servo_id: servo for servo in servos}
        self.spoil: Callable[[bytes], bytes] = lambda answer: answer
        self.late_ms = 0
        self.heard: list[tuple[int, int, bytes]] = []
        self.told: list[tuple[int, int, bytes]] = []  # every write: id, address, bytes
        self._in, self._out = bytearray(), deque[tuple[int, bytes]]()
        self._ms, self._silent_ms = 0, 0

    def receive(self, data: bytes) -> None:
        self._in += data
        while (packet := self.cut()) is not None:
            self.obey(*packet)

    def cut(self) -> tuple[int, int, bytes] | None:
        """The next instruction (id, number, parameters), taken off what has come in."""
        raise NotImplementedError

    def frame(self, servo_id: int, error: int, data: bytes) -> bytes:
        """An answer's bytes."""
        raise NotImplementedError

    def write(self, servo: Servo, address: int, data: bytes) -> None:
        self.told.append((servo.servo_id, address, data))
        servo.memory[address : address + len(data)] = data

    def split(self, parameters: bytes) -> tuple[int, int, bytes]:
        """Address, length and the rest of a sync instruction's parameters."""
        raise NotImplementedError

    def present(self) -> list[Servo]:
        return [servo for servo in self.servos.values() if not servo.gone]

    def obey(self, servo_id: int, instruction: int, parameters: bytes) -> None:
        self.heard.append((servo_id, instruction, parameters))
        self._silent_ms = 0
        if instruction == SYNC_READ:
            address, length, ids = self.split(parameters)
            for one in ids:  # in the order of the ids; who waits for one that is missing is silent
                servo = self.servos.get(one)
                if servo is None or servo.gone:
                    continue
                self.answer(servo, bytes(servo.memory[address : address + length]))
        elif instruction == SYNC_WRITE:
            address, length, rest = self.split(parameters)
            for k in range(0, len(rest), length + 1):
                servo = self.servos.get(rest[k])
                if servo is not None and not servo.gone:
                    self.write(servo, address, rest[k + 1 : k + 1 + length])
        else:
            self.obey_one(servo_id, instruction, parameters)

    def obey_one(self, servo_id: int, instruction: int, parameters: bytes) -> None:
        raise NotImplementedError

    def answer(self, servo: Servo, data: bytes) -> None:
        frame = self.spoil(self.frame(servo.servo_id, servo.alarm, data))
        self._out.append((self._ms + self.late_ms, frame))

    def step(self) -> None:
        """One millisecond of every servo."""
        self._ms += 1
        self._silent_ms += 1
        for servo in self.present():
            self.step_one(servo)

    def step_one(self, servo: Servo) -> None:
        raise NotImplementedError

    def take(self) -> bytes:
        out = b""
        while self._out and self._out[0][0] < self._ms:
            out += self._out.popleft()[1]
        return out


class FeetechBus(Bus):
    """STS3215: checksum ~(id + length + instruction + parameters), sign and magnitude."""

    def __init__(self, counts: dict[int, float]) -> None:
        super().__init__([Servo(servo_id, at) for servo_id, at in counts.items()])
        for servo in self.servos.values():
            servo.put(5, servo.servo_id, 1)
            servo.put(9, 0, 2)
            servo.put(11, 4095, 2)
            servo.put(18, 12, 1)  # as delivered
            servo.put(62, 121, 1)
            servo.put(63, 30, 1)
            self.step_one(servo)

    def cut(self) -> tuple[int, int, bytes] | None:
        data = self._in
        for k in range(len(data) - 5):
            if data[k] == data[k + 1] == 255 and data[k + 2] != 255:
                length = data[k + 3]
                end = k + 4 + length
                if length < 2 or end > len(data):
                    continue
                total = 0
                for byte in data[k + 2 : end - 1]:
                    total += byte
                if 255 - total % 256 == data[end - 1]:
                    found = (data[k + 2], data[k + 4], bytes(data[k + 5 : end - 1]))
                    del data[:end]
                    return found
        return None

    def frame(self, servo_id: int, error: int, data: bytes) -> bytes:
        inner = [servo_id, len(data) + 2, error, *data]
        return bytes([255, 255, *inner, 255 - sum(inner) % 256])

    def split(self, parameters: bytes) -> tuple[int, int, bytes]:
        return parameters[0], parameters[1], parameters[2:]

    def write(self, servo: Servo, address: int, data: bytes) -> None:
        super().write(servo, address, data)
        if address <= 42 < address + len(data):
            servo.memory[40] = 1  # as the maker's example WritePosEx has it

    def obey_one(self, servo_id: int, instruction: int, parameters: bytes) -> None:
        for servo in self.present():
            if servo_id not in (servo.servo_id, 254):
                continue
            if instruction == PING:
                self.answer(servo, b"")
            elif instruction == READ and servo_id != 254:
                self.answer(servo, bytes(servo.memory[parameters[0] :][: parameters[1]]))
            elif instruction == WRITE:
                self.write(servo, parameters[0], parameters[1:])
                if servo_id != 254:
                    self.answer(servo, b"")

    def step_one(self, servo: Servo) -> None:
        torque, speed = servo.memory[40] != 0, servo.get(46, 2)
        unit = 1.0 if servo.memory[18] & 4 else 50.0
        goal = servo.get(42, 2)
        goal = 0x8000 - goal if goal & 0x8000 else goal
        servo.turn(torque, float(goal), unit * speed if speed else TOP_COUNTS_S)
        counts = round(servo.counts)
        servo.put(56, abs(counts) | (0x8000 if counts < 0 else 0), 2)


class DynamixelBus(Bus):
    """XL430-W250: Protocol 2.0 with its bus watchdog, which freezes goals when it bites."""

    def __init__(self, counts: dict[int, float]) -> None:
        super().__init__([Servo(servo_id, at) for servo_id, at in counts.items()])
        self.frozen = dict.fromkeys(counts, False)
        for servo in self.servos.values():
            servo.put(7, servo.servo_id, 1)
            servo.put(11, 3, 1)
            servo.put(48, 4095, 4)
            servo.put(52, 0, 4)
            servo.put(144, 121, 2)
            servo.put(146, 30, 1)
            self.step_one(servo)

    @staticmethod
    def remainder(data: bytes) -> int:
        """CRC-16, bit by bit: x^16 + x^15 + x^2 + 1."""
        register = 0
        for byte in data:
            for bit in (7, 6, 5, 4, 3, 2, 1, 0):
                top = register >> 15 & 1
                register = register << 1 & 0xFFFE
                if top != byte >> bit & 1:
                    register ^= 0x8005
        return register

    def cut(self) -> tuple[int, int, bytes] | None:
        data = self._in
        for k in range(len(data) - 9):
            if bytes(data[k : k + 4]) != bytes([255, 255, 253, 0]):
                continue
            length = data[k + 5] + 256 * data[k + 6]
            end = k + 7 + length
            if end > len(data):
                continue
            if self.remainder(bytes(data[k : end - 2])) == data[end - 2] + 256 * data[end - 1]:
                inner = self.unstuff(bytes(data[k + 7 : end - 2]))
                found = (data[k + 4], inner[0], inner[1:])
                del data[:end]
                return found
        return None

    @staticmethod
    def unstuff(data: bytes) -> bytes:
        out = bytearray()
        run = 0  # how much of FF FF FD was just seen
        for byte in data:
            if run == 3 and byte == 253:
                run = 0
                continue
            out.append(byte)
            run = min(run + 1, 2) if byte == 255 else 3 if byte == 253 and run == 2 else 0
        return bytes(out)

    @staticmethod
    def stuff(data: bytes) -> bytes:
        out = bytearray()
        run = 0  # how much of FF FF FD was just seen
        for byte in data:
            out.append(byte)
            if byte == 255:
                run = min(run + 1, 2)
            elif byte == 253 and run == 2:
                out.append(253)
                run = 0
            else:
                run = 0
        return bytes(out)

    def frame(self, servo_id: int, error: int, data: bytes) -> bytes:
        inner = self.stuff(bytes([0x55, error]) + data)
        length = len(inner) + 2
        whole = bytes([255, 255, 253, 0, servo_id, length % 256, length // 256]) + inner
        check = self.remainder(whole)
        return whole + bytes([check % 256, check // 256])

    def split(self, parameters: bytes) -> tuple[int, int, bytes]:
        address, length = parameters[0] + 256 * parameters[1], parameters[2] + 256 * parameters[3]
        return address, length, parameters[4:]

    def write(self, servo: Servo, address: int, data: bytes) -> None:
        goal = 100 <= address < 120
        if goal and self.frozen[servo.servo_id]:
            return  # a range error, which sync write does not answer
        super().write(servo, address, data)
        if address == 98 and data == b"\0":
            self.frozen[servo.servo_id] = False
        if address == 64 and data == b"\1":
            servo.put(116, round(servo.counts), 4)  # the goal becomes the present position

    def obey_one(self, servo_id: int, instruction: int, parameters: bytes) -> None:
        for servo in self.present():
            if servo_id not in (servo.servo_id, 254):
                continue
            if instruction == PING:
                self.answer(servo, bytes([0x06, 0x04, 0x26]))
            elif instruction == READ and servo_id != 254:
                address, length, _ = self.split(parameters)
                self.answer(servo, bytes(servo.memory[address : address + length]))
            elif instruction == WRITE:
                self.write(servo, parameters[0] + 256 * parameters[1], parameters[2:])
                if servo_id != 254:
                    self.answer(servo, b"")

    def step_one(self, servo: Servo) -> None:
        torque, speed, patience = servo.memory[64] != 0, servo.get(112, 4), servo.memory[98]
        if torque and 0 < patience < 128 and self._silent_ms > 20 * patience:
            servo.put(98, 255, 1)
            servo.put(116, round(servo.counts), 4)  # it stops
            self.frozen[servo.servo_id] = True
        unit = 0.229 / 60 * 4096
        goal = int.from_bytes(servo.memory[116:120], "little", signed=True)
        servo.turn(torque, float(goal), unit * speed if speed else TOP_COUNTS_S)
        servo.put(132, round(servo.counts), 4)
