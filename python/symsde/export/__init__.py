# SPDX-License-Identifier: BSD-3-Clause
"""`symsde export`: a scene as a program in Fortran or C, which gives the same numbers and is a place to start from.

given             what a program needs of a scene
in_c              the program in C: the code of the emitters, and a main program
in_fortran        the program in Fortran
expressions       its formulas, as a person would write them
sites_in_fortran  its sums over sites
"""
