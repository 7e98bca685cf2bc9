! SPDX-License-Identifier: BSD-3-Clause
!> Models with some of their kernels withheld, so that the general way is compared with the fast one.
module kernels_in_tests
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model
   implicit none
   private
   public :: offer

contains

   !> Set which kernels a model says it has; an absent argument changes nothing. A model without kernels stays as it is.
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
