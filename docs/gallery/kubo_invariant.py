# SPDX-License-Identifier: BSD-3-Clause
"""
What symplectic schemes keep
============================

Hello.
"""
import matplotlib.pyplot as plt
plt.plot([1,2])
