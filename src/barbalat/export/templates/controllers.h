/*
 * All controllers of this folder. Made by barbalat, and made anew with each export into it.
 */
#ifndef CONTROLLERS_H
#define CONTROLLERS_H

${includes}
#endif
