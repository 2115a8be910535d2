# SPDX-License-Identifier: Apache-2.0
"""The journal of a run: what it computes, on the disk within a second, to be resumed or opened."""
