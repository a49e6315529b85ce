//! What a cloth is made of.

use serde::{Deserialize, Serialize};

use crate::Error;

/// The material of a cloth, in SI units.
///
/// The default is the cloth of the paper's table: inertia and weight are decoupled, because the
/// gravitational density `delta < rho` stands in for the aerodynamics of a light sheet (Coltraro
/// et al. 2022).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Area density `rho` [kg/m^2]: inertia.
    pub density: f64,
    /// Gravitational density `delta` [kg/m^2]: the weight of an area is `delta g`.
    pub gravitational_density: f64,
    /// Damping `alpha` [kg/(m^2 s)]: the force on an area is `-alpha v`, so velocities decay at the
    /// rate `alpha/rho` [1/s].
    pub damping: f64,
    /// Bending stiffness `kappa` [N m] of the energy `kappa/2 int |lap x|^2`.
    pub bending: f64,
    /// Shear stiffness `G` [N/m] of the energy `G/2 int sin^2(shear angle)`. The default is what the
    /// rows of the published scheme amount to inside its mesh, `16 rho dx dy / c` = 4 N/m. Plain weaves
    /// have some 10 to 60 N/m (Kawabata 1980: 0.2 to 1 gf/(cm deg), 1 gf/(cm deg) = 56 N/m).
    pub shear: f64,
    /// Internal damping [s]: a shear or bending force has the share `internal_damping d/dt` added
    /// (Kelvin, Voigt), so that a mode of angular frequency `w` has the damping ratio
    /// `internal_damping w / 2`.
    pub internal_damping: f64,
    /// Coulomb coefficient between cloth and table.
    pub friction_table: f64,
    /// Coulomb coefficient between cloth and cloth.
    pub friction_cloth: f64,
    /// Thickness [m]: distance at which two layers touch.
    pub thickness: f64,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            density: 0.3046,
            gravitational_density: 0.139,
            damping: 0.416,
            bending: 2.5e-5,
            shear: 4.0,
            internal_damping: 1e-2,
            friction_table: 0.2,
            friction_cloth: 0.6,
            thickness: 1e-3,
        }
    }
}

impl Material {
    /// Checks every field: densities and thickness positive, the rest not negative, all finite.
    ///
    /// # Errors
    /// [`Error::Value`] names the first field outside its bounds.
    pub fn check(&self) -> Result<(), Error> {
        Error::check_positive("density [kg/m^2]", self.density)?;
        Error::check_positive("gravitational density [kg/m^2]", self.gravitational_density)?;
        Error::check_not_negative("damping [kg/(m^2 s)]", self.damping)?;
        Error::check_not_negative("bending [N m]", self.bending)?;
        Error::check_not_negative("shear [N/m]", self.shear)?;
        Error::check_not_negative("internal damping [s]", self.internal_damping)?;
        Error::check_not_negative("table friction", self.friction_table)?;
        Error::check_not_negative("cloth friction", self.friction_cloth)?;
        Error::check_positive("thickness [m]", self.thickness)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_names_the_field() {
        assert_eq!(Material::default().check(), Ok(()));
        let bad = Material {
            bending: -1.0,
            ..Material::default()
        };
        assert_eq!(
            bad.check().unwrap_err().to_string(),
            "bending [N m] is -1, must be at least 0 and finite"
        );
        let bad = Material {
            density: f64::NAN,
            ..Material::default()
        };
        assert!(
            bad.check()
                .unwrap_err()
                .to_string()
                .starts_with("density [kg/m^2] is NaN")
        );
        let bad = Material {
            thickness: 0.0,
            ..Material::default()
        };
        assert!(bad.check().is_err());
    }
}
