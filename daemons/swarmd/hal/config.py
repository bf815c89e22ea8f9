"""Settings of the hardware abstraction (services/hal.toml)."""

from typing import Annotated, Any, Literal, TypeVar

import msgspec

from swarmware.devices.crsf import CHANNELS
from swarmware.devices.maxbotix import SonarUnit
from swarmware.geometry.geodesy import ORIGIN_ACC_M
from swarmware.model.config import convert

T = TypeVar("T", bound=msgspec.Struct)

Rate = Annotated[float, msgspec.Meta(gt=0, le=1000)]
RestRate = Annotated[float, msgspec.Meta(ge=5, le=1000)]
"""Rate at rest, from 5 Hz on, because `max_age_s` in the templates is three periods of 5 Hz."""
Gain = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Seconds = Annotated[float, msgspec.Meta(gt=0, le=3600)]
SpiSpeed = Annotated[int, msgspec.Meta(ge=1000, le=50_000_000)]
PulseWidth = Annotated[float, msgspec.Meta(ge=0, le=3000)]
RegisterBusName = Literal["i2c", "spi"]
Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
RcChannel = Annotated[int, msgspec.Meta(ge=1, le=CHANNELS)]
StickLimit = Annotated[float, msgspec.Meta(gt=0, le=100)]
VescQuantity = Literal["duty", "current", "speed"]


class SimDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `sim`: devices of the simulated vehicle, with their rates."""

    gnss_hz: Rate = 10.0
    """Rate of the satellite navigation receiver."""
    imu_hz: Rate = 20.0
    """Rate of the inertial unit."""
    range_hz: Rate = 10.0
    """Rate of the range scanner."""
    sonar_hz: Rate = 20.0
    """Rate of the sonar, which only air vehicles have."""
    rest_hz: RestRate = 5.0
    """Maximum rate of all devices while the vehicle is disarmed and on the ground."""
    battery_hz: Rate = 1.0
    """Rate of the battery monitor."""
    sonar_window: Annotated[int, msgspec.Meta(ge=1, le=99)] = 5
    """Window of the median filter, in echoes (S2.49)."""


class ChassisConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the chassis, for all drivers."""

    drive: str = "act/drive"
    """Board of the set-points that the chassis follows."""
    rate_hz: Rate = 20.0
    """Rate at which set-points are sent to the chassis."""
    rest_hz: RestRate = 5.0
    """Rate of set-points while the vehicle is disarmed and on the ground."""
    watchdog_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 0.5
    """Age of the newest set-point above which an armed vehicle is stopped; an air vehicle hovers."""
    gains: dict[str, Gain] = {}
    """Gains of the controllers by name, sent after each opening; gains without an entry keep their
    default."""
    answer_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 1.0
    """Time within which the chassis must answer an order."""
    origin_acc_m: Annotated[float, msgspec.Meta(gt=0, le=1000)] = ORIGIN_ACC_M
    """Maximum error of the fix at which the flight controller of an airframe sets the origin of its map."""


class SystemDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `system`: load of the computer."""

    rate_hz: Rate = 1.0
    """Rate of `system/load`."""


class ReplayDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `replay`: packets of a recording, at the rate of the recorded device."""

    file: str = "vlp16/recording.bin"
    """Path of the recording, absolute or below share/swarm/data."""
    packet_bytes: Annotated[int, msgspec.Meta(ge=1, le=65_000)] = 1206
    """Size of each packet of the recording."""
    packets_hz: Annotated[float, msgspec.Meta(gt=0, le=100_000)] = 753.0
    """Rate of the packets; a VLP-16 in strongest-return mode sends 753 to 754 a second."""
    path: str = "sensor/lidar"
    """Stream on which the packets are published."""
    wake_hz: Rate = 20.0
    """Rate of the wake-ups at which due packets are written; each packet has its own stamp."""
    slots: Annotated[int, msgspec.Meta(ge=16, le=100_000)] = 512
    """Size of the ring in packets, which is the maximum lag of a slow reader."""
    loop: bool = True
    """Repeat the recording from its end."""


class RecordingDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `recording`: replays the log of a vehicle in place of its devices."""

    folder: str = "/var/lib/swarm/replay"
    """Folder with log segments (`*.mcap`) of a logger."""
    file: str = ""
    """Export of a log by `swarmctl log export --format msgpack`, or "" to read the folder."""
    platform: str = ""
    """Platform whose resources are published, or "" for the platform of the first entry."""
    pattern: str = "sensor/*"
    """Pattern of the published resources, such as `{sensor,power}/**`."""
    speed: Annotated[float, msgspec.Meta(ge=0.01, le=50)] = 1.0
    """Seconds of the recording that are played in one second."""
    loop: bool = True
    """Repeat the recording from its end."""
    wake_hz: Rate = 50.0
    """Rate of the wake-ups at which due entries are published; each entry has its own stamp."""


class NmeaDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `nmea`: a satellite receiver on a serial line, NMEA 0183 and UBX."""

    device: str = "/dev/ttyUSB0"
    """Device file of the serial line."""
    baud: int = 38_400
    """Bit rate of the line; 9600 carries fewer than five fixes a second."""
    rate_hz: Rate = 10.0
    """Expected rate of fixes; each fix is published when it arrives."""
    path: str = "sensor/gnss"
    """Board on which the fixes are published."""


class VectorNavDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `vectornav`: an inertial unit of VectorNav on a serial line."""

    device: str = "/dev/ttyUSB1"
    """Device file of the serial line."""
    baud: int = 115_200
    """Bit rate of the serial line."""
    rate_hz: Rate = 100.0
    """Output rate that is set in the unit; each measurement is published when it arrives."""
    path: str = "sensor/imu"
    """Board on which the measurements are published."""


class SonarDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `sonar`: a MaxBotix sonar on a serial line, directed to the ground."""

    device: str = "/dev/ttyS1"
    """Device file of the serial line."""
    baud: int = 9600
    """Bit rate of the serial line."""
    unit: SonarUnit = SonarUnit.MM
    """Unit of the readings: inch (LV models), cm (XL), mm (HRXL)."""
    rate_hz: Rate = 10.0
    """Expected rate of the readings; each reading is published when it arrives."""
    min_m: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    """Range below which readings are ignored; the models report 0.2 to 0.3 m for everything nearer."""
    max_m: Annotated[float, msgspec.Meta(gt=0, le=100)] = 5.0
    """Range above which readings are ignored, because the ground is out of range."""
    window: Annotated[int, msgspec.Meta(ge=1, le=99)] = 5
    """Window of the median filter, in readings."""
    path: str = "sensor/height"
    """Board on which the height above the ground is published."""


class PilotSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Channels of the safety pilot's transmitter, and the scaling of its sticks."""

    rate_hz: Rate = 20.0
    """Maximum rate at which the sticks are published."""
    switch_channel: RcChannel = 6
    """Channel of the switch, whose upper end is manual and lower end is auto."""
    roll_channel: RcChannel = 1
    """Channel of the stick for motion to the right."""
    pitch_channel: RcChannel = 2
    """Channel of the stick for motion forward."""
    throttle_channel: RcChannel = 3
    """Channel of the stick for climbing, which keeps the height in its centre."""
    yaw_channel: RcChannel = 4
    """Channel of the stick for turning to the right."""
    dead_band_ratio: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.05
    """Deflection of a stick that counts as its centre."""
    speed_m_s: StickLimit = 3.0
    """Horizontal speed at full deflection of the stick."""
    climb_m_s: StickLimit = 1.5
    """Climb rate at full deflection of the stick."""
    turn_rad_s: StickLimit = 1.0
    """Yaw rate at full deflection of the stick."""


class CrsfDriver(PilotSettings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `crsf`: a radio-control receiver with the switch and the sticks of the safety pilot."""

    device: str = "/dev/ttyAMA0"
    """Device file of the line, which has 420 000 baud."""


class PpmDriver(PilotSettings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `ppm`: a radio-control receiver with a sum signal at a GPIO line."""

    device: str = "/dev/gpiochip0"
    """Device file of the chip."""
    line: Annotated[int, msgspec.Meta(ge=0, le=1023)] = 17
    """Number of the chip's line, whose rising edges separate the channels."""


class SerialChassisDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `serial_chassis`: a chassis on a serial line."""

    device: str = "/dev/ttyACM0"
    """Device file of the serial line."""
    baud: int = 115_200
    """Bit rate of the serial line."""


class AnalogueChannel(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One input of an analogue-digital converter."""

    channel: Annotated[int, msgspec.Meta(ge=0, le=255)]
    """Number of the input at the converter."""
    path: str
    """Board on which the values of the input are published."""
    per_volt: float = 1.0
    """Value that one volt at the input stands for, such as 10 behind a divider of 1:10."""
    unit: str = "V"
    """Unit of the published value."""


class AdcDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `adc`: analogue inputs by the industrial I/O of Linux."""

    device: str = "/sys/bus/iio/devices/iio:device0"
    """Folder of the converter in sysfs."""
    rate_hz: Rate = 10.0
    """Rate at which all channels are read."""
    channels: tuple[AnalogueChannel, ...] = ()
    """Inputs of the converter that are published."""


class CameraDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `camera`: pictures of a camera or stream, read with PyAV (extra `video`)."""

    device: str = "/dev/video0"
    """File of the camera, address of a stream (`rtsp://camera/1`), or a recording."""
    format: str = "v4l2"
    """Input format of FFmpeg, or "" to detect the format of the source."""
    width: Annotated[int, msgspec.Meta(ge=16, le=8192)] = 640
    """Width in pixels that is requested from the camera; pictures of another size are scaled."""
    height: Annotated[int, msgspec.Meta(ge=16, le=8192)] = 480
    """Height in pixels that is requested from the camera."""
    rate_hz: Annotated[float, msgspec.Meta(ge=0.1, le=240)] = 15.0
    """Pictures per second that are requested from the camera."""
    encoding: Literal["rgb8", "mono8", "jpeg"] = "rgb8"
    """Encoding of the images; `jpeg` comes from the camera if possible, else from Pillow (extra `images`)."""
    quality: Annotated[int, msgspec.Meta(ge=1, le=100)] = 80
    """Quality of images that this driver compresses to JPEG."""
    path: str = "sensor/camera"
    """Stream on which the images are published."""


class Bmp280Driver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `bmp280`: a barometer BMP280 or BME280."""

    bus: RegisterBusName = "i2c"
    """Bus of the chip, i2c or spi."""
    device: str = "/dev/i2c-1"
    """Device file of the bus, such as `/dev/i2c-1` or `/dev/spidev0.0`."""
    address: Annotated[int, msgspec.Meta(ge=0x08, le=0x77)] = 0x76
    """Address on I2C, 0x76, or 0x77 if the pin SDO is high."""
    speed_hz: SpiSpeed = 1_000_000
    """Clock frequency of the bus on SPI."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=23)] = 10.0
    """Rate of readings; the chip measures 23 times a second."""
    path: str = "sensor/barometer"
    """Board on which the measurements are published."""


class InvensenseDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `invensense`: an inertial unit MPU-6000, -6050, -6500, -9250, ICM-20602 or -20608."""

    bus: RegisterBusName = "spi"
    """Bus of the chip, i2c or spi."""
    device: str = "/dev/spidev0.0"
    """Device file of the bus."""
    address: Annotated[int, msgspec.Meta(ge=0x08, le=0x77)] = 0x68
    """Address on I2C, 0x68, or 0x69 if the pin AD0 is high."""
    speed_hz: SpiSpeed = 1_000_000
    """Clock frequency on SPI; the registers of the oldest of these chips allow at most 1 MHz."""
    rate_hz: Rate = 100.0
    """Rate at which the chip is read."""
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    """Axes of the chip that point forward, left and up, with `-` for an axis in the opposite direction."""
    path: str = "sensor/imu"
    """Board on which the measurements are published."""


class ServoOutput(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One output of pulses, for a servo or a motor controller."""

    channel: Annotated[int, msgspec.Meta(ge=0, le=255)]
    """Number of the PWM channel at the chip."""
    path: str
    """Board of the set-points, -1 to 1."""
    center_us: PulseWidth = 1500.0
    """Pulse width for the set-point 0."""
    range_us: Annotated[float, msgspec.Meta(ge=-1500, le=1500)] = 500.0
    """Change of the pulse width for the set-point 1, negative to reverse the direction."""
    safe_us: PulseWidth = 1500.0
    """Pulse width without a fresh set-point, or 0 to stop the pulses."""
    needs_arming: bool = False
    """Set the output to `safe_us` while the vehicle is disarmed, for a motor and not for a rudder."""


class ServoDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `servo`: pulse outputs by the PWM of Linux."""

    device: str = "/sys/class/pwm/pwmchip0"
    """Folder of the PWM chip in sysfs."""
    rate_hz: Annotated[float, msgspec.Meta(ge=10, le=400)] = 50.0
    """Pulses per second of all outputs; analogue servos accept 50."""
    watchdog_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 0.5
    """Age of a set-point above which its output goes to the safe width."""
    outputs: tuple[ServoOutput, ...] = ()
    """Outputs that the driver serves."""


class MotorPulse(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One motor controller that is set by the width of pulses."""

    channel: Annotated[int, msgspec.Meta(ge=0, le=255)]
    """Number of the PWM channel at the chip."""
    stop_us: PulseWidth = 1000.0
    """Pulse width at which the motor is stopped."""
    full_us: PulseWidth = 2000.0
    """Pulse width at which the motor has full power."""

    def width_us(self, output: float) -> float:
        """Width of the pulses for an output from 0 to 1."""
        return self.stop_us + min(max(output, 0.0), 1.0) * (self.full_us - self.stop_us)


class ServoPulse(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One servo of an airframe, with its pulse widths."""

    channel: Annotated[int, msgspec.Meta(ge=0, le=255)]
    """Number of the PWM channel at the chip."""
    center_us: PulseWidth = 1500.0
    """Pulse width at the centre of the servo."""
    range_us: Annotated[float, msgspec.Meta(ge=-1500, le=1500)] = 500.0
    """Change of the pulse width to the end of the servo, negative to reverse the direction."""

    def width_us(self, output: float) -> float:
        """Width of the pulses for an output from -1 to 1."""
        return self.center_us + min(max(output, -1.0), 1.0) * self.range_us


class PwmFlightDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `pwm_flight`: an airframe with motors and servos on PWM, flown by the flight controller.

    The inertial unit has a separate driver, whose `path` is `imu` and whose rate is the airframe's rate of
    control.
    """

    device: str = "/sys/class/pwm/pwmchip0"
    """Folder of the PWM chip in sysfs."""
    pulses_hz: Annotated[float, msgspec.Meta(ge=10, le=490)] = 400.0
    """Pulses per second of all outputs: 400 for motor controllers, 50 for analogue servos."""
    imu: str = "sensor/imu_raw"
    """Board of the inertial unit's samples, whose mean is published in `sensor/imu`."""
    imu_hz: Rate = 20.0
    """Rate at which `sensor/imu` is published."""
    motors: tuple[MotorPulse, ...] = ()
    """Motors in the order of the airframe."""
    servos: tuple[ServoPulse, ...] = ()
    """Servos in the order of the airframe; for a helicopter lateral, longitudinal, collective, pedal."""


class VescMotor(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One motor behind a VESC controller."""

    controller: Annotated[int, msgspec.Meta(ge=0, le=254)]
    """Number of the controller on the bus."""
    path: str
    """Board of the set-points, -1 to 1."""
    state_path: str
    """Board of the motor's state."""
    quantity: VescQuantity = "duty"
    """Quantity of the set-points: duty (ratio of the voltage), current (A) or speed (electrical rpm)."""
    full_scale: Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)] = 0.5
    """Value for the set-point 1, in the unit of the quantity, negative to reverse the direction."""
    needs_arming: bool = True
    """Stop the motor's current while the vehicle is disarmed."""


class VescDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `vesc`: VESC motor controllers on a CAN bus; needs the extra `can`."""

    interface: str = "socketcan"
    """Kind of the interface by its python-can name: socketcan, slcan, virtual."""
    device: str = "can0"
    """Name of the interface in `ip link`, which also sets the bit rate."""
    rate_hz: Rate = 50.0
    """Commands per second to each motor."""
    watchdog_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 0.5
    """Age of a set-point above which its motor gets no current."""
    motors: tuple[VescMotor, ...] = ()
    """Motors that the driver serves."""


class RecognitionRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rule that starts a driver when a device is plugged in (S4.30)."""

    path: Annotated[str, msgspec.Meta(pattern=r"^/[^*?\[]*/[^/]+$")]
    """Pattern of the device files, such as `/dev/ttyUSB*`, with wildcards only in the last name."""
    driver: str
    """Driver that is started for each device; its key `device` is set to the device file."""
    usb: Annotated[str, msgspec.Meta(pattern="^([0-9a-fA-F]{4}:[0-9a-fA-F]{4})?$")] = ""
    """Identifiers `vendor:product` of the USB device, as `lsusb` prints them, or "" for any device."""
    settings: dict[str, Any] = {}
    """Further keys of the driver's settings."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Drivers of the platform, and their settings."""

    drivers: tuple[str, ...] = ("sim", "system")
    """Names of drivers, which are built in (see `devices.md`) or in installed packages."""
    retry_s: Seconds = 2.0
    """Pause before a device is opened again."""
    failures: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 10
    """Consecutive failed reads after which the device is reopened."""
    report_hz: Rate = 1.0
    """Rate at which `hal/drivers` is published."""
    line_bit_s: dict[str, Annotated[float, msgspec.Meta(gt=0, le=1e10)]] = {}
    """Bit rate of lines and buses by device; a device without an entry has the rate of its standard."""
    chassis: ChassisConfig = ChassisConfig()
    sim: SimDriver = SimDriver()
    system: SystemDriver = SystemDriver()
    replay: ReplayDriver = ReplayDriver()
    recording: RecordingDriver = RecordingDriver()
    nmea: NmeaDriver = NmeaDriver()
    vectornav: VectorNavDriver = VectorNavDriver()
    sonar: SonarDriver = SonarDriver()
    crsf: CrsfDriver = CrsfDriver()
    ppm: PpmDriver = PpmDriver()
    serial_chassis: SerialChassisDriver = SerialChassisDriver()
    adc: AdcDriver = AdcDriver()
    camera: CameraDriver = CameraDriver()
    bmp280: Bmp280Driver = Bmp280Driver()
    invensense: InvensenseDriver = InvensenseDriver()
    servo: ServoDriver = ServoDriver()
    pwm_flight: PwmFlightDriver = PwmFlightDriver()
    vesc: VescDriver = VescDriver()
    recognise: tuple[RecognitionRule, ...] = ()
    """Rules for devices that are plugged in; the first matching rule applies."""
    plugins: dict[str, dict[str, Any]] = {}
    """Settings of drivers from installed packages, as tables `[plugins.NAME]`."""

    def plugin(self, name: str, cls: type[T]) -> T:
        """Settings of an installed driver from its table, or the defaults without a table.

        Raises: ConfigError when the table does not match the class.
        """
        return convert(self.plugins.get(name, {}), cls, f"services/hal.toml: table plugins.{name}")
