"""The GSM modem."""

from drivers.modem.interface import Modem
from drivers.modem.values import ModemStatus, Sms

__all__ = ["Modem", "ModemStatus", "Sms"]
