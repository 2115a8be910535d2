# SPDX-License-Identifier: Apache-2.0
"""``python -m cartoloop`` is ``cartoloop``."""

from cartoloop.cli.start import main

main()
