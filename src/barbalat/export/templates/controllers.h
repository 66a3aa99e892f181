/*
 * All controllers of this folder. Written by barbalat; each export into the folder rewrites this file.
 */
#ifndef CONTROLLERS_H
#define CONTROLLERS_H

${includes}
#endif
