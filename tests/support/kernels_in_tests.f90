! SPDX-License-Identifier: BSD-3-Clause
!> Models with some of their kernels hidden, so that a test compares the general way with the fast one.
module kernels_in_tests
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model
   implicit none
   private
   public :: offer

contains

   !> Say which kernels a model offers; an absent argument changes nothing, and a model without kernels is left as it
   !> is.
   subroutine offer(model, angle, rows)
      class(model_type), intent(inout) :: model
      logical, intent(in), optional :: angle, rows

      select type (model)
      class is (kernel_model)
         if (present(angle)) model%offers%angle = angle
         if (present(rows)) model%offers%rows = rows
      end select
   end subroutine offer

end module kernels_in_tests
