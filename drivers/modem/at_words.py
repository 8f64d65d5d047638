"""What a modem's numbers mean: error codes (3GPP 27.007, 9.2; 27.005, 3.2.5) and states of registration."""

from __future__ import annotations

EQUIPMENT_ERRORS = {
    0: "phone failure", 3: "operation not allowed", 4: "operation not supported", 5: "PH-SIM PIN required",
    10: "SIM not inserted", 11: "SIM PIN required", 12: "SIM PUK required", 13: "SIM failure", 14: "SIM busy",
    15: "SIM wrong", 16: "incorrect password", 17: "SIM PIN2 required", 18: "SIM PUK2 required", 20: "memory full",
    21: "invalid index", 22: "not found", 23: "memory failure", 24: "text string too long",
    25: "invalid characters in text string", 26: "dial string too long", 27: "invalid characters in dial string",
    30: "no network service", 31: "network timeout", 32: "network not allowed - emergency calls only",
    40: "network personalisation PIN required", 50: "incorrect parameters", 100: "unknown",
    107: "GPRS services not allowed", 111: "PLMN not allowed", 112: "location area not allowed",
    113: "roaming not allowed in this location area",
}  # fmt: skip
MESSAGE_ERRORS = {
    1: "unassigned number", 8: "operator determined barring", 10: "call barred", 21: "short message transfer rejected",
    27: "destination out of service", 28: "unidentified subscriber", 29: "facility rejected",
    30: "unknown subscriber", 38: "network out of order", 41: "temporary failure", 42: "congestion",
    47: "resources unavailable", 50: "requested facility not subscribed", 69: "requested facility not implemented",
    96: "invalid mandatory information", 111: "protocol error", 300: "ME failure", 301: "SMS service of ME reserved",
    302: "operation not allowed", 303: "operation not supported", 304: "invalid PDU mode parameter",
    305: "invalid text mode parameter", 310: "SIM not inserted", 311: "SIM PIN required", 312: "PH-SIM PIN required",
    313: "SIM failure", 314: "SIM busy", 315: "SIM wrong", 316: "SIM PUK required", 320: "memory failure",
    321: "invalid memory index", 322: "memory full", 330: "SMSC address unknown", 331: "no network service",
    332: "network timeout", 340: "no +CNMA acknowledgement expected", 500: "unknown error",
}  # fmt: skip
ERROR_TABLES = {"+CME ERROR": EQUIPMENT_ERRORS, "+CMS ERROR": MESSAGE_ERRORS}

REGISTRATION = {
    0: "not registered and not searching", 1: "registered, home network", 2: "searching", 3: "registration denied",
    4: "not known", 5: "registered, roaming", 6: "registered for texts alone, home network",
    7: "registered for texts alone, roaming", 8: "emergency calls alone",
}  # fmt: skip
REGISTERED = frozenset({1, 5, 6, 7})

SIM_ABSENT, SIM_PIN_REQUIRED, SIM_PUK_REQUIRED, SIM_FAILURE, SIM_BUSY, SIM_WRONG, WRONG_PIN = 10, 11, 12, 13, 14, 15, 16
STORE_BUSY, NO_SERVICE, MEMORY_FULL = 314, 331, 322


def signal_dbm(rssi: int) -> float | None:
    """Of the first figure of ``+CSQ`` (27.007, 8.5); LTE modems tell 100 to 191. None when it is not known."""
    if 0 <= rssi <= 31:
        return -113.0 + 2.0 * rssi
    if 100 <= rssi <= 191:
        return -116.0 + (rssi - 100)
    return None
