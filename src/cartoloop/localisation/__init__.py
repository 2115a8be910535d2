# SPDX-License-Identifier: Apache-2.0
"""Localisation in a finished map: from nowhere, from a pose, and while driving."""
