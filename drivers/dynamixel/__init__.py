"""Dynamixel servos, protocol 2.0 (XL330, XL430, XM430), as pan axis and zoom ring."""

from drivers.dynamixel.axis import DynamixelAxis as DynamixelAxis
from drivers.dynamixel.bus import DynamixelBus as DynamixelBus
from drivers.dynamixel.group import move_together as move_together
from drivers.dynamixel.group import statuses as statuses
from drivers.dynamixel.probe import FoundServo as FoundServo
from drivers.dynamixel.probe import probe as probe
from drivers.dynamixel.settings import DynamixelSettings as DynamixelSettings
