# SPDX-License-Identifier: Apache-2.0
"""What differs between a map and what a robot that is located in it sees."""
