"""The GSM modem."""

from drivers.modem.interface import Modem
from drivers.modem.values import DeliveryReport, ModemStatus, RejectedText, Sms

__all__ = ["DeliveryReport", "Modem", "ModemStatus", "RejectedText", "Sms"]
