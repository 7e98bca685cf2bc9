# SPDX-License-Identifier: BSD-3-Clause
"""`symsde export`: a scene as a program in Fortran or C, which gives the same numbers and is a place to start from.

given             what a program needs of a scene
expressions       formulas as a person would write them
in_c, in_fortran  the program
sites_in_fortran  sums over sites in Fortran
"""
