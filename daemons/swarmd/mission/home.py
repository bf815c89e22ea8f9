"""The place where the vehicle was armed, on a board from which a restarted daemon restores it."""

from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import Pose, VehicleState

PATH = "vehicle/home"


class Home:
    """Follows `vehicle/state`; writes `vehicle/home`."""

    def __init__(
        self, state: BoardReader[VehicleState], pose: BoardReader[Pose], board: BoardWriter[Pose]
    ) -> None:
        self._state = state
        self._pose = pose
        self._board = board
        self._armed = False
        self.place: Pose | None = None
        """None: the arming of the vehicle was not observed."""

    @classmethod
    def open(cls, module: Module, pose: BoardReader[Pose]) -> "Home":
        """Opens the board; restores the place if the vehicle is still armed."""
        board = module.reader(PATH, Pose)
        before = board.value
        board.close()
        writer = module.writer(PATH, Pose, log="all", description="Where the vehicle was armed")
        state = module.reader("vehicle/state", VehicleState)
        home = cls(state, pose, writer)
        now = state.value
        if now is not None and now.armed:
            home._armed = True
            if before is not None:
                home._set(before)
        return home

    async def follow(self) -> None:
        """Records the place at each arming, as soon as the position is known."""
        async for state in self._state:
            if state.armed and not self._armed:
                if (pose := self._pose.value) is None:
                    continue  # the state is published again, at least once a second
                self._set(pose)
            self._armed = state.armed

    def _set(self, pose: Pose) -> None:
        self.place = pose
        self._board.write(pose)
