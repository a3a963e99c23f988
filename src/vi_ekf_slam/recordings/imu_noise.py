"""The noise of an IMU as calibrations state it: densities and random walks of both sensors."""

from collections import namedtuple

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.yaml_file import yaml_number

ImuNoise = namedtuple("ImuNoise", "gyro_density gyro_walk accelerometer_density accelerometer_walk rate")
ImuNoise.__doc__ = """gyro_density rad/s/sqrt(Hz), gyro_walk rad/s^2/sqrt(Hz), accelerometer_density m/s^2/sqrt(Hz),
accelerometer_walk m/s^3/sqrt(Hz): continuous-time; rate Hz, at which a sample has the variance density^2 rate."""

# Names in Kalibr's imu.yaml and in the sensor.yaml of ASL folders, in the order of ImuNoise.
KEYS = ("gyroscope_noise_density", "gyroscope_random_walk", "accelerometer_noise_density", "accelerometer_random_walk")
UNITS = ("rad/s/sqrt(Hz)", "rad/s^2/sqrt(Hz)", "m/s^2/sqrt(Hz)", "m/s^3/sqrt(Hz)")

LARGEST = 1e6  # in these units and in Hz: beyond any IMU, and whose squares messages can hold


def noise_from_yaml(values, rate_key, path):
    """ImuNoise of the mapping that a calibration file holds. rate_key: its name of the rate in Hz."""
    numbers = []
    for key, unit in zip(KEYS + (rate_key,), UNITS + ("Hz",)):
        if key not in values:
            raise InputError("%s: key '%s' is missing" % (path, key))
        try:
            number = float(values[key])
        except (TypeError, ValueError):
            raise InputError("%s: %s is %r, allowed: a number in %s" % (path, key, values[key], unit))
        numbers.append(checks.require_positive(number, "%s: %s" % (path, key), unit))
        if number > LARGEST:
            raise InputError("%s: %s is %g %s, allowed: up to %g" % (path, key, number, unit, LARGEST))
    return ImuNoise(*numbers)


def variances(noise):
    """(gyro (rad/s)^2, accelerometer (m/s^2)^2) of one sample's coordinate."""
    return noise.gyro_density**2 * noise.rate, noise.accelerometer_density**2 * noise.rate


def kalibr_yaml(noise, topic):
    """Text of an imu.yaml as Kalibr reads and writes it."""
    lines = ["%s: %s  # %s" % (key, yaml_number(value), unit) for key, unit, value in zip(KEYS, UNITS, noise)]
    return "\n".join(lines + ["rostopic: %s" % topic, "update_rate: %s  # Hz" % yaml_number(noise.rate)]) + "\n"
