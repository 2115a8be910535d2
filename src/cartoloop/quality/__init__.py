# SPDX-License-Identifier: Apache-2.0
"""What a map knows of its own errors: contradictions between visits, gaps, weak places."""
