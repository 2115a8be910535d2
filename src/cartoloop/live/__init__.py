# SPDX-License-Identifier: Apache-2.0
"""Live sources: what a robot sends while it drives, into sensor events and a map."""
