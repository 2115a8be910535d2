# SPDX-License-Identifier: Apache-2.0
"""``python -m bench paper``: the experiments of section VI, and the report of them."""
