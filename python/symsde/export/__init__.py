# SPDX-License-Identifier: BSD-3-Clause
"""`symsde export`: a scene as a program in Fortran or C, which gives the same numbers and is a place to start from.

given             the parts of a scene that a program needs
in_c              the program in C: the code of the emitters, and a main program
in_fortran        the program in Fortran
expressions       formulas in Fortran, as a person would write them
sites_in_fortran  sums over sites in Fortran
"""
