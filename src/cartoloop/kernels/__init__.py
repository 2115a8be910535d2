# SPDX-License-Identifier: Apache-2.0
"""All compiled code: functions of arrays and scalars, one module a step of the paper, no policy."""
