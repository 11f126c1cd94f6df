"""What the names of columns say of them, in the languages and habits of recorders."""

from __future__ import annotations

import re

TIME = re.compile(
    r"(?i)^(t|time|timestamp|zeit|temps|date|datetime|elapsed|clock)(\b|_(ns|us|ms|s|min|h|d)$)|time|stamp"
)
INPUT = re.compile(
    r"(?i)^(u\d*|in(put)?\d*)$|^u[_ ]|^u(est|val)$|command|cmd|drive|torque|force|voltage|current|excit|pump|actuat"
    r"|^f$|^f_?[xyz]$"
)
REFERENCE = re.compile(r"(?i)ref|setpoint|set_point|demand|target")
AUX = re.compile(r"(?i)temp|humid|pressure|index|^n$|^i$|flag|status|^#$")
AXIS = re.compile(r"(?i)(?:^|[_ \[(])(theta_?[xyz]|[xyz]|\d+)(?:[\])]|$)|(?<=[a-z])(\d+)$")
VALUE = re.compile(r"(?i)^(val(ue|eur)?|reading|wert|data)\b")
