# SPDX-License-Identifier: Apache-2.0
"""What the operator's live view costs, and how soon it shows what happens."""
