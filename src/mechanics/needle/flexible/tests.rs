mod beam;
mod springs;
