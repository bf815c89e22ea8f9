"""Where the vehicle was armed: kept on a board, so that a restarted daemon still knows it."""

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
        """None: nobody saw the vehicle being armed."""

    @classmethod
    def open(cls, module: Module, pose: BoardReader[Pose]) -> "Home":
        """The place of before, while the vehicle is still armed since then."""
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
        """Takes the place at each arming; where the position is not known yet, as soon as it is."""
        async for state in self._state:
            if state.armed and not self._armed:
                if (pose := self._pose.value) is None:
                    continue  # the state comes again, once a second at least
                self._set(pose)
            self._armed = state.armed

    def _set(self, pose: Pose) -> None:
        self.place = pose
        self._board.write(pose)
